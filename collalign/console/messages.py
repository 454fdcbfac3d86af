"""What a command says: sentences for people, one object for programs (``--json``), and a file of both (``--log``)."""

from __future__ import annotations

import json
import logging
import os
import stat
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import datetime
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from collalign.engine.command_line import json_types
from collalign.engine.progress import SHOW_BARS, STAGES
from data_tools.errors import InputError, printable
from data_tools.io.files import system_reason

_ROOT, _PRINTED = logging.getLogger("collalign"), logging.getLogger("collalign.said")
#: First line of a log, and of a log whose lines are JSON: nothing is appended to a file that begins otherwise.
_FIRST_LINE, _FIRST_JSON_LINE = (
    "# log of collalign\n",
    '{"format": "collalign-log", "version": 1}\n',
)
_JSON_SUFFIX = ".jsonl"
#: For ``os.open``: no pipe is waited for, no child inherits the file, bytes come as they are; each system has some.
_FOR_APPENDING = os.O_RDWR | os.O_APPEND | os.O_CREAT
_FOR_APPENDING |= (
    getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
)


@dataclass
class _Messages:
    """What a command prints, and what it has put into the object for programs."""

    is_silent: bool = False
    as_json: bool = False
    began_s: float = field(default_factory=time.perf_counter)
    summary: dict[str, Any] = field(default_factory=dict)


_MESSAGES: ContextVar[_Messages] = ContextVar("messages")


def say(sentence: str) -> None:
    """Print a sentence for people: on standard output, which ``--quiet`` and ``--json`` keep free."""
    sentence = printable(sentence, keep="\n")
    if not _messages().is_silent:
        print(sentence, flush=True)  # somebody may wait for it at the end of a pipe
    _PRINTED.info(sentence)


def warn(sentence: str) -> None:
    """Print what people should not miss on standard error, and tell programs."""
    sentence = printable(sentence, keep="\n")
    print(f"collalign: {sentence}", file=sys.stderr)
    _PRINTED.warning(sentence)
    _messages().summary.setdefault("warnings", []).append(sentence)


def say_files(paths: Iterable[Path]) -> None:
    """Print the paths of what was written, and tell programs."""
    for path in paths:
        say(str(path))
        _messages().summary.setdefault("files", []).append(str(path))


def add_to_summary(**items: Any) -> None:
    """Put items into the object that ``--json`` prints."""
    _messages().summary.update(items)


def elapsed_s() -> float:
    """Return for how many seconds the command has run, or its work on one of many folders."""
    return time.perf_counter() - _messages().began_s


@contextmanager
def separate_summary() -> Iterator[dict[str, Any]]:
    """Gather what this block puts into the summary in an object of its own, as for one of many folders."""
    messages = _messages()
    outer, messages.summary = messages.summary, {}
    began_s, messages.began_s = messages.began_s, time.perf_counter()
    try:
        yield messages.summary
    finally:
        messages.summary, messages.began_s = outer, began_s


@contextmanager
def command_messages() -> Iterator[None]:
    """Let one command write within this block; :func:`configure_output` says how."""
    token, bars = _MESSAGES.set(_Messages()), SHOW_BARS.set(True)
    former = _ROOT.level, _ROOT.propagate, _ROOT.handlers
    _ROOT.handlers = [*_ROOT.handlers, logging.NullHandler()]  # an early error is said once
    try:
        yield
    finally:
        for handler in _ROOT.handlers:
            if handler not in former[2]:
                handler.close()
        _ROOT.level, _ROOT.propagate, _ROOT.handlers = former
        _MESSAGES.reset(token)
        SHOW_BARS.reset(bars)


def configure_output(*, quiet: bool, as_json: bool, verbose: bool, log: Path | None) -> None:
    """Choose what the command of this block prints; stages go to standard error, as bars or, off a terminal, lines.

    Raises
    ------
    InputError
        If the log cannot be written, or is a file that is no log of this program.
    """
    messages = _messages()
    messages.is_silent, messages.as_json = quiet or as_json, as_json
    SHOW_BARS.set(not quiet)
    lines = logging.StreamHandler(sys.stderr)
    shows_stages = not quiet and not sys.stderr.isatty()
    lines.addFilter(
        lambda record: (
            record.name != _PRINTED.name
            and (
                record.levelno >= logging.WARNING
                or verbose
                or (shows_stages and record.name == STAGES.name)
            )
        )
    )
    handlers: list[logging.Handler] = [lines, _Summary(logging.WARNING)]
    if log is not None:
        try:
            handlers.append(_LogFile(log))
        except OSError as error:
            raise InputError(f"--log {log}: cannot be written ({system_reason(error)})") from None
    _ROOT.handlers, _ROOT.propagate = [*_ROOT.handlers, *handlers], False
    _ROOT.setLevel(logging.INFO)


class _Summary(logging.Handler):
    """Warnings of the library, which programs are told like those of the command."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.name != _PRINTED.name:
            _messages().summary.setdefault("warnings", []).append(record.getMessage())


class _LogFile(logging.FileHandler):
    """Appends to a new file, an empty one, or a log of ours; JSON lines where its name ends with ``.jsonl``."""

    def __init__(self, path: Path) -> None:
        self._is_json = path.suffix.lower() == _JSON_SUFFIX
        self._lacks_lines = False
        super().__init__(path)
        self.setFormatter(
            _JsonLines() if self._is_json else logging.Formatter("%(asctime)s %(message)s")
        )

    def handleError(self, record: logging.LogRecord) -> None:
        """Say once that the log lacks lines, for instance where the disk is full."""
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            super().handleError(record)
        elif not self._lacks_lines:
            self._lacks_lines = True
            warn(
                f"--log {self.baseFilename}: lines are missing ({system_reason(error)}); results are not affected"
            )

    def close(self) -> None:
        """Close the file, also where its last lines cannot be written."""
        with suppress(OSError):
            super().close()

    def _open(self) -> TextIOWrapper:
        """Decide about the file that is open, which nobody can exchange meanwhile."""
        path, first = (
            self.baseFilename,
            (_FIRST_JSON_LINE if self._is_json else _FIRST_LINE).encode(),
        )
        descriptor = os.open(path, _FOR_APPENDING, 0o644)
        try:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise InputError(f"--log {path}: is not a regular file; name a new file")
            if not (found := os.read(descriptor, len(first))):
                os.write(descriptor, first)
            elif found != first:
                raise InputError(
                    f"--log {path}: is not a log of this program, so nothing was written to it. Name a new file"
                )
            return open(descriptor, "a", encoding="utf-8", errors="backslashreplace")
        except BaseException:
            os.close(descriptor)
            raise


class _JsonLines(logging.Formatter):
    """One JSON object a line: ``time``, ``level``, ``message``, and of stages the numbers."""

    def format(self, record: logging.LogRecord) -> str:
        entry = {
            "time": datetime.fromtimestamp(record.created)
            .astimezone()
            .isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "message": record.getMessage(),
        }
        return json.dumps(entry | getattr(record, "numbers", {}))


def end(code: int, error: str = "") -> int:
    """Say how the command ended, to whom it concerns, and return its exit code."""
    if error:
        error = printable(error, keep="\n")
        add_to_summary(error=error)
        _PRINTED.error(error)
    _PRINTED.info("exit code %d", code, extra={"numbers": {"exit_code": code}})
    messages = _messages()
    if messages.as_json:
        print(json.dumps(json_types({"exit_code": code} | messages.summary), indent=1))
    return code


def _messages() -> _Messages:
    """Return the output of the running command; functions that are called without one have their own."""
    return _MESSAGES.get(None) or _Messages()
