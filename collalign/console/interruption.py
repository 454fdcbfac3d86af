"""Ctrl-C: the run ends in order and says how to go on; pressing it again while that lasts breaks nothing."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from collalign.engine.store_file import STORE_FILE
from data_tools.errors import RunLost

if TYPE_CHECKING:
    from collalign.engine.run_options import RunOptions

#: Exit codes: something was left out; ``status`` of a run that is not finished; interrupted.
INCOMPLETE, UNFINISHED, INTERRUPTED = 3, 5, 130
#: What every interruption says in the end.
GO_ON = "run the same command to go on"


@contextmanager
def orderly_interrupts(*, until_exit: bool) -> Iterator[None]:
    """Turn the first SIGINT into KeyboardInterrupt, answer the second with patience, end the process at the third.

    Everything finished is in the store at any time, and worker processes end with their parent.

    Parameters
    ----------
    until_exit : bool
        The process ends after this: go on after an interruption, so that no late SIGINT meets Python's own handler.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set handlers, and only it is interrupted
        return
    former, excepthook = signal.signal(signal.SIGINT, _first), threading.excepthook
    try:
        yield
    finally:
        if not until_exit:
            threading.excepthook = excepthook
        signal.signal(signal.SIGINT, signal.SIG_IGN if until_exit and was_interrupted() else former)


def was_interrupted() -> bool:
    """Return whether a SIGINT has come since handlers were set."""
    return signal.getsignal(signal.SIGINT) in (_second, _third)


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
    signal.signal(signal.SIGINT, _second)
    warnings.filterwarnings("ignore", module="joblib")  # it advises to wait for all results
    threading.excepthook = lambda arguments: (
        None
    )  # what threads of the pool miss now is missing on purpose
    raise KeyboardInterrupt


def _second(number: int, frame: FrameType | None) -> None:
    signal.signal(signal.SIGINT, _third)
    print("collalign: ending in order; once more ends it at once", file=sys.stderr, flush=True)


def _third(number: int, frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)
