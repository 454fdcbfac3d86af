"""The command line: parses, calls the library, prints, and turns errors into advice and an exit code.

Exit codes: 0 all went well, 1 unexpected error, 2 bad input or options, 3 finished with something left out, 4 the
workers were lost, 5 (of ``status``) not finished, 129, 130 and 143 interrupted by SIGHUP, Ctrl-C and SIGTERM,
141 nobody reads the output any more.

* ``align_command``: ``align``, ``add``, ``demo``
* ``batch_command``, ``status``: many folders; how far a run is
* ``check``, ``config``: reads files only; reads options
* ``own_file``: what the caller knows, from files
* ``open_workspace``, ``open_command``: what is shown of a result, and the commands run on its files; who is let in

The commands of tools are listed in ``collalign/tools/__init__.py``. Only the command line prints and exits.
"""

from __future__ import annotations

import errno
import shlex
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter

from collalign import __version__
from collalign.cli.config import ConfigFile, refuse_rounding
from collalign.console.help import HELP_ALL, GroupedHelp
from collalign.console.interruption import (
    GO_ON,
    interruption_code,
    orderly_interrupts,
    was_interrupted,
)
from collalign.console.messages import add_to_summary, command_messages, configure_output, end
from collalign.console.streams import Streams
from collalign.engine.command_line import COMMAND
from collalign.tools import TOOLS
from data_tools.errors import CollalignError, printable
from data_tools.io.files import system_reason

app = App(
    name="collalign",
    help="Align a collection of 3D shapes consistently, and say how far each pose can be trusted.",
    version=__version__,
    result_action="return_value",
    suppress_keyboard_interrupt=False,
    help_format="plaintext",  # the list of commands has no markup, and its reader takes long to import
)
app.meta.suppress_keyboard_interrupt = False
#: Each command's function and its line in the help; a function is imported when its command is called.
_COMMANDS = {
    "align": ("collalign.cli.align_command:align", "Align all shapes of a folder."),
    "demo": (
        "collalign.cli.align_command:demo",
        "Generate a small collection, align it, compare with the truth.",
    ),
    "add": (
        "collalign.cli.align_command:add",
        "Align new shapes to a finished result without moving the old ones.",
    ),
    "batch": (
        "collalign.cli.batch_command:batch",
        "Align many folders; one that fails does not stop the others.",
    ),
    "open": (
        "collalign.cli.open_command:open_app",
        "Open a result in the browser, correct it and go on.",
    ),
    "status": ("collalign.cli.status:status", "Say how far a run is, or make its store smaller."),
    **{name: (f"collalign.tools.{function}", line) for name, (function, line) in TOOLS.items()},
}
for _name, (_function, _help) in _COMMANDS.items():
    app.command(_function, name=_name, help=_help, help_format="markdown")


@app.meta.default
def _launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    config: Path | None = None,
    verbose: Annotated[bool, Parameter(name=["--verbose", "-v"], negative=())] = False,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative=())] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative=())] = False,
    log: Path | None = None,
) -> Any:
    """Run a command.

    Parameters
    ----------
    config
        TOML file with options of the command; the command line wins over it.
    verbose
        Say what is being done, and show the whole traceback of an error.
    quiet
        Print warnings and errors only.
    as_json
        Print one JSON object instead of text: what came out, files, warnings, errors, exit code.
    log
        File that what is said and each stage are appended to, with the time: a new one, or a log of an earlier
        command. Where its name ends with .jsonl, each line is a JSON object.
    """
    configure_output(quiet=quiet, as_json=as_json, verbose=verbose, log=log)
    app.config = (
        (refuse_rounding,) if config is None else (ConfigFile(config, _COMMANDS), refuse_rounding)
    )
    running = COMMAND.set(shlex.join(["collalign", *tokens]))
    try:
        return app(tokens, exit_on_error=False)
    finally:
        COMMAND.reset(running)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        ``sys.argv[1:]`` by default.
    """
    until_exit = arguments is None
    with (
        Streams.guarded(until_exit=until_exit) as streams,
        orderly_interrupts(until_exit=until_exit),
    ):
        code = _run(list(sys.argv[1:] if arguments is None else arguments))
        return streams.code_after(code)


@command_messages()
def _run(words: list[str]) -> int:
    """Run a command; every way to end has its message and its exit code."""
    app.config = ()  # an earlier call may have set one
    app.help_formatter = GroupedHelp(everything=HELP_ALL in words)
    words = ["--help" if word == HELP_ALL else word for word in words]
    try:
        add_to_summary(command=next((word for word in words if word in _COMMANDS), ""))
        return end(int(app.meta(words, exit_on_error=False) or 0))
    except CycloptsError as error:
        return end(2, str(error))
    except KeyboardInterrupt as interrupt:
        return _say(
            str(interrupt) or f"interrupted; no file is left half-written; {GO_ON}",
            interruption_code(),
        )
    except Exception as error:
        if "-v" in words or "--verbose" in words:
            traceback.print_exc()
        if was_interrupted():  # an import that SIGINT met makes another error of it
            return _say(f"interrupted before anything began; {GO_ON}", interruption_code())
        if _lacks_descriptors(error):
            return _say("too many open files; allow more (ulimit -n 1024), or take fewer --jobs", 1)
        if not isinstance(error, CollalignError | OSError):
            raise
        if (
            isinstance(error, OSError)
            and not isinstance(error, CollalignError)
            and error.errno is not None
        ):
            return _say(f"{error.filename or 'a file'}: {system_reason(error)}", 1)
        return _say(str(error), error.exit_code if isinstance(error, CollalignError) else 1)


def _lacks_descriptors(error: BaseException | None) -> bool:
    """Return whether an error, or one before it, is that no more files can be opened."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            return True
        error = error.__cause__ or error.__context__
    return False


def _say(message: str, code: int) -> int:
    message = printable(message, keep="\n")
    print(f"collalign: {message}", file=sys.stderr)
    return end(code, message)
