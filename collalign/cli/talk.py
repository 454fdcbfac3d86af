"""What a command says: sentences for people, one object for programs (``--json``), and a file of both (``--log``)."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from collalign.engine.jobs.progress import SHOW_BARS, STAGES
from data_tools.errors import InputError

_ROOT, _SAID = logging.getLogger("collalign"), logging.getLogger("collalign.said")


@dataclass
class _Talk:
    """How a command speaks, and what it has told programs."""

    is_silent: bool = False
    as_json: bool = False
    summary: dict[str, Any] = field(default_factory=dict)


_TALK: ContextVar[_Talk] = ContextVar("talk")


def say(sentence: str) -> None:
    """Print a sentence for people: on standard output, which ``--quiet`` and ``--json`` keep free."""
    if not _talk().is_silent:
        print(sentence)
    _SAID.info(sentence)


def warn(sentence: str) -> None:
    """Print what people should not miss on standard error, and tell programs."""
    print(f"collalign: {sentence}", file=sys.stderr)
    _SAID.warning(sentence)
    _talk().summary.setdefault("warnings", []).append(sentence)


def say_files(paths: Iterable[Path]) -> None:
    """Print the paths of what was written, and tell programs."""
    for path in paths:
        say(str(path))
        _talk().summary.setdefault("files", []).append(str(path))


def tell(**items: Any) -> None:
    """Put items into the object that ``--json`` prints."""
    _talk().summary.update(items)


@contextmanager
def told_apart() -> Iterator[dict[str, Any]]:
    """Gather what is told in this block in an object of its own, as for one of many folders."""
    talk = _talk()
    outer, talk.summary = talk.summary, {}
    try:
        yield talk.summary
    finally:
        talk.summary = outer


@contextmanager
def talking() -> Iterator[None]:
    """Let one command speak within this block; :func:`speak` says how."""
    token, bars = _TALK.set(_Talk()), SHOW_BARS.set(True)
    former = _ROOT.level, _ROOT.propagate, _ROOT.handlers
    try:
        yield
    finally:
        for handler in _ROOT.handlers:
            if handler not in former[2]:
                handler.close()
        _ROOT.level, _ROOT.propagate, _ROOT.handlers = former
        _TALK.reset(token)
        SHOW_BARS.reset(bars)


def speak(*, quiet: bool, as_json: bool, verbose: bool, log: Path | None) -> None:
    """Say how the command of this block speaks; stages go to standard error, as bars or, off a terminal, as lines.

    Raises
    ------
    InputError
        If the log cannot be written.
    """
    talk = _talk()
    talk.is_silent, talk.as_json = quiet or as_json, as_json
    SHOW_BARS.set(not quiet)
    lines = logging.StreamHandler(sys.stderr)
    shows_stages = not quiet and not sys.stderr.isatty()
    lines.addFilter(
        lambda record: (
            record.name != _SAID.name
            and (record.levelno >= logging.WARNING or verbose or (shows_stages and record.name == STAGES.name))
        )
    )
    handlers: list[logging.Handler] = [lines]
    if log is not None:
        try:
            handlers.append(logging.FileHandler(log, encoding="utf-8", errors="backslashreplace"))
        except OSError as error:
            raise InputError(f"--log {log}: cannot be written ({error.strerror})") from None
        handlers[-1].setFormatter(logging.Formatter("%(asctime)s %(message)s"))
    _ROOT.handlers, _ROOT.propagate = [*_ROOT.handlers, *handlers], False
    _ROOT.setLevel(logging.INFO)


def end(code: int, error: str = "") -> int:
    """Say how the command ended, to whom it concerns, and return its exit code."""
    if error:
        tell(error=error)
        _SAID.error(error)
    _SAID.info("exit code %d", code)
    talk = _talk()
    if talk.as_json:
        from collalign.output.evidence.gather import json_types  # help shall not wait for it

        print(json.dumps(json_types({"exit_code": code} | talk.summary), indent=1))
    return code


def _talk() -> _Talk:
    """Return how the command speaks that runs; functions that are called without one speak by themselves."""
    return _TALK.get(None) or _Talk()
