"""The command line: parses, calls the library, prints, and turns errors into advice and an exit code.

Exit codes: 0 all went well, 1 unexpected error, 2 bad input or options, 3 finished with something left out,
130 interrupted.
"""

from __future__ import annotations

import logging
import sys
import tomllib
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter
from cyclopts.config import Toml

from collalign import __version__
from collalign.cli.align import add, align, demo
from collalign.cli.batch import batch
from collalign.cli.match import match
from collalign.cli.results import classify, export, view
from collalign.cli.status import status
from data_tools.errors import CollalignError, InputError

INTERRUPTED = 130

app = App(
    name="collalign",
    help="Align a collection of 3D shapes consistently, and say how far each pose can be trusted.",
    version=__version__,
    result_action="return_value",
)
for command in (align, match, demo, add, batch, status, export, classify, view):
    app.command(command)


@app.meta.default
def _launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    config: Path | None = None,
    verbose: Annotated[bool, Parameter(name=["--verbose", "-v"], negative=())] = False,
) -> Any:
    """Run a command.

    Parameters
    ----------
    config
        TOML file with options of the command; the command line wins over it.
    verbose
        Say what is being done, and show the whole traceback of an error.
    """
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format="%(message)s", stream=sys.stderr)
    app.config = () if config is None else (_checked_toml(config),)
    return app(tokens, exit_on_error=False)


def _checked_toml(path: Path) -> Toml:
    try:
        tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise InputError(f"--config {path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise InputError(f"--config {path}: not TOML ({error})") from None
    return Toml(path, must_exist=True, search_parents=False, use_commands_as_keys=False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        ``sys.argv[1:]`` by default.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    app.config = ()  # an earlier call may have set one
    try:
        code = app.meta(words, exit_on_error=False)
    except CycloptsError:
        return 2
    except CollalignError as error:
        if "-v" in words or "--verbose" in words:
            traceback.print_exc()
        print(f"collalign: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(
            "collalign: interrupted; what is finished is kept, the same command goes on from there", file=sys.stderr
        )
        return INTERRUPTED
    return int(code or 0)
