"""``collalign open``: a server of this machine alone, with addresses that work once and few connections."""

from __future__ import annotations

import json
import os
import secrets
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import resources
from pathlib import Path
from queue import Empty, SimpleQueue
from socket import SHUT_RDWR, SHUT_WR, socket
from socketserver import ThreadingMixIn
from tempfile import TemporaryFile
from threading import BoundedSemaphore, Lock, Thread
from typing import IO, Any, BinaryIO, cast
from wsgiref.simple_server import (
    ServerHandler,
    WSGIRequestHandler,
    WSGIServer,
    make_server,
)

from collalign.cli.open_workspace import Workspace
from collalign.console.messages import say
from data_tools.errors import CollalignError, InputError, OptionsError
from data_tools.html_pages import html_page
from data_tools.io.temporary import TemporaryFolder

#: Largest file that the page may send, in bytes: it is read as a whole later.
MOST_UPLOADED_BYTES = 64 * 2**20
_MOST_REQUEST_BYTES = 2**20
#: Connections that are open at a time, and for how long one may say nothing.
_MOST_CONNECTIONS, _SILENT_S = 32, 20.0
_PIECE = 2**16
#: How long what is sent beyond an answer is waited for, and pieces of it that are read.
_LAST_WORDS_S, _MOST_LAST_WORDS = 1.0, 64
_HOST = "127.0.0.1"
#: What a browser lets the page of this command do, and the pages of a result, which may come from anybody.
_INLINE = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)
_PAGE_POLICY = (
    f"{_INLINE}; connect-src 'self'; frame-src 'self'; frame-ancestors 'none'; form-action 'none'"
)
_RESULT_POLICY = (
    f"{_INLINE}; sandbox allow-scripts allow-downloads; frame-ancestors 'self'; form-action 'none'"
)
_NOTICE_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'"
_HOW_TO_COME_IN = (
    "Open the address that was printed last in the terminal where <code>collalign open</code> runs, or end that "
    "command and run it again."
)


class Doors:
    """The addresses that let a browser in, each once, and what it proves later that it has been let in with.

    Attributes
    ----------
    base : str
        Path of everything that is served. Browsers send cookies to all ports of a machine: this one goes no further.
    cookie, session : str
        Name and value of the cookie.
    results : str
        Part of the paths of result pages, which are shown in a sandbox: links there carry no cookie.
    file : Path
        Page that only this user can read. It leads to an address, so that the browser, whose arguments every user
        of the machine can see, is given none.
    """

    def __init__(self, port: int, private: Path) -> None:
        self.base = f"/{secrets.token_urlsafe(8)}/"
        self.cookie, self.session = f"collalign-{port}", secrets.token_urlsafe()
        self.results = secrets.token_urlsafe()
        self._origin = f"http://{_HOST}:{port}"
        self._keys, self._lock = set[str](), Lock()
        self._printed = SimpleQueue[str]()
        self._key_printed = ""
        self.file = private / "open.html"
        with open(os.open(self.file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(_leading("Opening the result", self._address(self._new_key())))
        self._print_next()

    def printed(self) -> str:
        """Return the address that is printed next; wait until there is one."""
        while True:
            with suppress(Empty):  # where nothing interrupts a wait without end
                return self._printed.get(timeout=1.0)

    def enter(self, key: str) -> bool:
        """Return whether a key lets in, now and never again."""
        with self._lock:
            known = [
                one for one in self._keys if secrets.compare_digest(one.encode(), key.encode())
            ]
            self._keys.difference_update(known)
            if self._key_printed in known:
                self._print_next()
        return bool(known)

    def _print_next(self) -> None:
        self._key_printed = self._new_key()
        self._printed.put(self._address(self._key_printed))

    def _new_key(self) -> str:
        key = secrets.token_urlsafe()
        self._keys.add(key)
        return key

    def _address(self, key: str) -> str:
        return f"{self._origin}{self.base}enter/{key}"


class Server(ThreadingMixIn, WSGIServer):
    """A server of one page with a thread for each of a few connections.

    Attributes
    ----------
    doors : Doors
    """

    daemon_threads = True
    request_queue_size = _MOST_CONNECTIONS
    doors: Doors

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._free, self._silent = BoundedSemaphore(_MOST_CONNECTIONS), dict[socket, None]()
        self._lock = Lock()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread; where there are too many, the connection that has said nothing for longest is closed."""
        if not self._free.acquire(blocking=False):
            with self._lock, suppress(OSError, StopIteration):
                next(iter(self._silent)).shutdown(SHUT_RDWR)
            if not self._free.acquire(timeout=1.0):
                self.shutdown_request(request)
                return
        with self._lock:
            self._silent[request] = None
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # the system gives no thread
            self.has_spoken(request)
            self._free.release()
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and let the next one in."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.has_spoken(request)
            self._free.release()

    def has_spoken(self, request: Any) -> None:
        """Note that a whole request has come."""
        with self._lock:
            self._silent.pop(request, None)


class _Quiet(WSGIRequestHandler):
    """Answers one request, within a time, and says nothing of requests or of connections that break."""

    timeout = _SILENT_S
    server: Server

    def handle(self) -> None:
        with suppress(OSError):
            self.raw_requestline = self.rfile.readline(_PIECE + 1)
            if len(self.raw_requestline) > _PIECE or not self.parse_request():
                return
            self.server.has_spoken(self.connection)
            app = self.server.get_app()
            assert app is not None
            output = cast(IO[bytes], self.wfile)
            answer = _Answer(self.rfile, output, self.get_stderr(), self.get_environ())
            answer.request_handler = self
            answer.run(app)
            # A connection that is closed with something unread breaks, and its answer may be lost.
            self.connection.shutdown(SHUT_WR)
            self.connection.settimeout(_LAST_WORDS_S)
            for _ in range(_MOST_LAST_WORDS):
                if not self.connection.recv(_PIECE):
                    return

    def log_message(self, format: str, *arguments: Any) -> None:
        """Say nothing of requests, whose addresses hold keys."""


class _Answer(ServerHandler):
    request_handler: WSGIRequestHandler

    def log_exception(self, exc_info: Any) -> None:
        """Say what went wrong here, and nothing of connections that break."""
        if not isinstance(exc_info[1], OSError):
            super().log_exception(exc_info)


def served(workspace: Workspace, private: Path) -> Server:
    """Return a server of a result at a free port of this machine.

    Parameters
    ----------
    workspace : Workspace
    private : Path
        Folder that only this user can look into.

    Raises
    ------
    OptionsError
        If the extra is missing.
    """
    try:
        import bottle
    except ImportError as error:
        raise OptionsError(
            f"open needs a server ({error}); install it with: pip install 'collalign[app]'"
        ) from None
    app = bottle.Bottle()
    server = make_server(_HOST, 0, app, server_class=Server, handler_class=_Quiet)
    doors = server.doors = Doors(server.server_port, private)
    hosts = {f"{name}:{server.server_port}" for name in (_HOST, "localhost")}
    base, results = doors.base, f"{doors.base}result/{doors.results}/"

    def is_let_in() -> bool:
        given = bottle.request.get_cookie(doors.cookie) or ""
        return secrets.compare_digest(given.encode(), doors.session.encode())

    def guard() -> None:
        given, path = bottle.request.headers, bottle.request.path
        origins = {None, *(f"http://{host}" for host in hosts)}
        if given.get("Host") not in hosts or given.get("Origin") not in origins:
            raise refused("This is not for other machines or pages", "")
        is_result = secrets.compare_digest(path[: len(results)].encode(), results.encode())
        is_open = is_result or path.startswith(f"{base}enter/")
        if not (is_let_in() or (is_open and bottle.request.method == "GET")):
            raise refused("You have not been let in", f"<p>{_HOW_TO_COME_IN}</p>")

    def refused(title: str, body: str) -> Any:
        return noticed(html_page(title, body), status=403)

    def noticed(content: bytes, **more: Any) -> Any:
        return bottle.HTTPResponse(content, **more, **_headers(_NOTICE_POLICY))

    def plain(run: Callable[..., Any]) -> Callable[..., Any]:
        def answered(*args: Any, **values: Any) -> Any:
            try:
                return run(*args, **values)
            except RecursionError:
                return said("nested too deeply", 400)
            except (CollalignError, OSError, ValueError, TypeError, AttributeError) as error:
                return said(str(error), 400)

        return answered

    def said(text: str, status: int) -> Any:
        return bottle.HTTPResponse(text, status, content_type="text/plain; charset=utf-8")

    def page(file: Any, policy: str) -> Any:
        if file is None:
            return bottle.HTTPResponse(status=404)
        return bottle.HTTPResponse(file.read_bytes(), **_headers(policy))

    def enter(key: str) -> Any:
        if not is_let_in():
            if not doors.enter(key):
                return refused(
                    "This address has been used",
                    f"<p>It lets one browser in, once. {_HOW_TO_COME_IN}</p><p>If this browser has been let in "
                    f'before, <a href="{base}">go on here</a>. If nobody of yours has used the address, end the '
                    "command with Ctrl-C: somebody else has read it.</p>",
                )
            answer = noticed(_leading("You are let in", base))
            answer.set_cookie(
                doors.cookie, doors.session, path=base, httponly=True, samesite="strict"
            )
            return answer
        return noticed(_leading("You are let in", base))

    @contextmanager
    def received(most: int) -> Iterator[BinaryIO]:
        """Put what comes into a file, piece by piece."""
        left = bottle.request.content_length
        if left < 0:
            raise InputError("the request does not say how long it is")
        if left > most:
            raise InputError(f"{left} bytes, at most {most} are taken; make it smaller first")
        with TemporaryFile(dir=private) as file:
            while left:
                piece = bottle.request.environ["wsgi.input"].read(min(left, _PIECE))
                if not piece:
                    raise InputError("the connection broke off before all was here; send it again")
                file.write(piece)
                left -= len(piece)
            file.seek(0)
            yield file

    def put(name: str) -> Any:
        with received(MOST_UPLOADED_BYTES) as file:
            return workspace.put(name, file)

    def start(task: str) -> None:
        with received(_MOST_REQUEST_BYTES) as file:
            workspace.start(task, json.load(file))

    own = resources.files("collalign.cli").joinpath("open_page.html")
    more = {"results": f"result/{doors.results}/", "mostBytes": MOST_UPLOADED_BYTES}
    app.add_hook("before_request", guard)
    app.install(plain)
    app.get(base, callback=lambda: page(own, _PAGE_POLICY))
    app.get(f"{base}enter/<key>", callback=enter)
    app.get(
        f"{results}<name:path>", callback=lambda name: page(workspace.page(name), _RESULT_POLICY)
    )
    app.get(f"{base}state", callback=lambda: workspace.state() | more)
    app.get(f"{base}progress", callback=workspace.progress)
    app.post(f"{base}files/<name>", callback=put)
    app.post(f"{base}run/<task>", callback=start)
    app.post(f"{base}stop", callback=workspace.stop)
    return server


def _headers(policy: str) -> dict[str, str]:
    return {
        "Content-Type": "text/html; charset=utf-8",
        "Content-Security-Policy": policy,
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }


def _leading(title: str, address: str) -> bytes:
    """Return a page that goes on to an address by itself; a redirect of HTTP would not carry the cookie."""
    refresh = f'<meta http-equiv="refresh" content="0; url={address}">\n'
    return html_page(title, f'<p><a href="{address}">Go on to the page</a></p>', head=refresh)


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
    with TemporaryFolder() as private, served(workspace, private) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        try:
            say(f"{server.doors.printed()}\n{_ONCE} Press Ctrl-C to end.")
            webbrowser.open(server.doors.file.as_uri())  # one of the terminal returns at its end
            while True:
                say(f"{server.doors.printed()}\n{_ONCE}")
        finally:
            server.shutdown()
            workspace.stop()


#: What is said of each address.
_ONCE = "This address works once, on this machine; the next one is printed then."
