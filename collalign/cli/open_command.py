"""``collalign open``: the pages of a result, served to this machine alone, where decisions take effect."""

from __future__ import annotations

import json
import secrets
import webbrowser
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from collalign.cli.workspace import Workspace
from collalign.console.messages import say
from data_tools.errors import CollalignError, OptionsError

#: What a browser lets the page of this command do, and the pages of a result, which may come from anybody.
_INLINE = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
_PAGE_POLICY = f"{_INLINE}; connect-src 'self'; frame-src 'self'; frame-ancestors 'none'; form-action 'none'"
_RESULT_POLICY = f"{_INLINE}; sandbox allow-scripts allow-downloads; frame-ancestors 'self'; form-action 'none'"


def open_app(place: Path, *, sources: Path | None = None) -> int:
    """Open a result in the browser: correct poses and landmarks, run again, transfer, compare, export.

    Every button runs a command of this command line and shows it. Needs the extra ``app``; Ctrl-C ends.

    Parameters
    ----------
    place
        Folder that ``collalign align`` wrote, or a folder of shapes, which the page offers to align.
    sources
        Folder of the original files where they have moved; the page asks for it as well.
    """
    workspace = Workspace(place, sources)
    with served(workspace) as server:
        say(f"{server.address}\nOnly this machine can open it. Press Ctrl-C to end.")
        webbrowser.open(server.address)
        try:
            server.serve_forever()
        finally:
            workspace.stop()
    return 0


class Server(ThreadingMixIn, WSGIServer):
    """A server of one page at ``address``, which holds the token that every request needs."""

    daemon_threads = True
    address: str


class _Quiet(WSGIRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing of requests, whose addresses hold the token."""


def served(workspace: Workspace) -> Server:
    """Return a server of a result at a free port of this machine; an ``OptionsError`` if the extra is missing."""
    try:
        import bottle
    except ImportError as error:
        raise OptionsError(f"open needs a server ({error}); install it with: pip install 'collalign[app]'") from None
    app, token = bottle.Bottle(), secrets.token_urlsafe()
    server = make_server("127.0.0.1", 0, app, server_class=Server, handler_class=_Quiet)
    server.address = f"http://127.0.0.1:{server.server_port}/{token}/"
    hosts = {f"{name}:{server.server_port}" for name in ("127.0.0.1", "localhost")}

    def guard() -> None:
        given = bottle.request.headers
        known = secrets.compare_digest(bottle.request.path.split("/")[1].encode(), token.encode())
        origins = {None, *(f"http://{host}" for host in hosts)}
        if not (known and given.get("Host") in hosts and given.get("Origin") in origins):
            raise bottle.HTTPResponse("Not for you.", 403)

    def plain(run: Callable[..., Any]) -> Callable[..., Any]:
        def answered(*args: Any, **values: Any) -> Any:
            try:
                return run(*args, **values)
            except RecursionError:
                return bottle.HTTPResponse("nested too deeply", 400, content_type="text/plain; charset=utf-8")
            except (CollalignError, OSError, ValueError, TypeError, AttributeError) as error:
                return bottle.HTTPResponse(str(error), 400, content_type="text/plain; charset=utf-8")

        return answered

    def page(file: Any, policy: str) -> Any:
        headers = {"Content-Security-Policy": policy, "Referrer-Policy": "no-referrer", "Cache-Control": "no-store"}
        bottle.response.headers.update(headers)
        return bottle.HTTPResponse(status=404) if file is None else file.read_bytes()

    own = resources.files("collalign.cli").joinpath("open_page.html")
    app.add_hook("before_request", guard)
    app.install(plain)
    app.get(f"/{token}/", callback=lambda: page(own, _PAGE_POLICY))
    app.get(f"/{token}/result/<name:path>", callback=lambda name: page(workspace.page(name), _RESULT_POLICY))
    app.get(f"/{token}/state", callback=workspace.state)
    app.get(f"/{token}/progress", callback=workspace.progress)
    app.post(f"/{token}/files/<name>", callback=lambda name: workspace.put(name, bottle.request.body.read()))
    app.post(f"/{token}/run/<task>", callback=lambda task: workspace.start(task, json.load(bottle.request.body)))
    app.post(f"/{token}/stop", callback=workspace.stop)
    return server
