"""Ctrl-C, SIGTERM and SIGHUP: the run ends in order and says how to go on; another one meanwhile breaks nothing."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from collalign.engine.command_line import ENDING, can_be_answered
from collalign.engine.store_file import STORE_FILE
from data_tools.errors import RunLost

if TYPE_CHECKING:
    from collalign.engine.run_options import RunOptions

#: Exit codes: something was left out; ``status`` of a run that is not finished.
INCOMPLETE, UNFINISHED = 3, 5
#: What every interruption says in the end.
GO_ON = "run the same command to go on"


@dataclass
class _Came:
    """The signal that came first, SIGINT unless it is another one; and whether one came."""

    number: int = signal.SIGINT
    is_here: bool = False


_CAME = _Came()


@contextmanager
def orderly_interrupts(*, until_exit: bool) -> Iterator[None]:
    """Turn the first signal that asks the command to end into KeyboardInterrupt.

    Everything finished is in the store at any time, and worker processes end with their parent. A person who presses
    Ctrl-C again is asked for patience, and ends the process with the third. What a closed terminal or a batch system
    sends again is ignored: they send it several times.

    Parameters
    ----------
    until_exit : bool
        The process ends after this: go on after an interruption, so that no late signal meets another handler.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set handlers, and only it is interrupted
        return
    _CAME.number, _CAME.is_here = signal.SIGINT, False
    former = {number: signal.signal(number, _first) for number in filter(can_be_answered, ENDING)}
    excepthook = threading.excepthook
    try:
        yield
    finally:
        if not until_exit:
            threading.excepthook = excepthook
        for number, handler in former.items():
            signal.signal(number, signal.SIG_IGN if until_exit and _CAME.is_here else handler)


def was_interrupted() -> bool:
    """Return whether a signal has come since handlers were set."""
    return _CAME.is_here


def interruption_code() -> int:
    """Return the exit code of an interrupted command: 128 and the number of the signal, 130 for Ctrl-C."""
    return 128 + _CAME.number


@contextmanager
def resumable(run: RunOptions, folder: Path) -> Iterator[RunOptions]:
    """Add to an interruption, by a person or by the loss of a cluster, what is kept and how to go on.

    Parameters
    ----------
    run : RunOptions
    folder : Path
        Of the results: everything finished is kept in the store there unless the options name another one.

    Yields
    ------
    RunOptions
        With the store.

    Raises
    ------
    KeyboardInterrupt
        With the sentence as its argument.
    RunLost
        Likewise.
    """
    run = replace(run, store=run.store or folder / STORE_FILE)
    kept = f"everything finished is kept in {run.store}; {GO_ON}"
    try:
        yield run
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {kept}") from None
    except RunLost as error:
        raise RunLost(f"{error}; {kept}") from error


def _first(number: int, frame: FrameType | None) -> None:
    _CAME.number, _CAME.is_here = number, True
    for other in ENDING:
        if signal.getsignal(other) is _first:
            signal.signal(other, _second if other == signal.SIGINT else signal.SIG_IGN)
    warnings.filterwarnings("ignore", module="joblib")  # it advises to wait for all results
    threading.excepthook = lambda arguments: (
        None
    )  # what threads of the pool miss now is missing on purpose
    raise KeyboardInterrupt


def _second(number: int, frame: FrameType | None) -> None:
    signal.signal(signal.SIGINT, _third)
    with suppress(OSError, RuntimeError):  # nobody reads it, or it came in the midst of a line
        print("collalign: ending in order; once more ends it at once", file=sys.stderr, flush=True)


def _third(number: int, frame: FrameType | None) -> None:
    os._exit(interruption_code())
