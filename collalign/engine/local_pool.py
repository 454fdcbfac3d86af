"""The worker processes of joblib on one machine: how they start, how long they wait for work, and how they end.

joblib is imported where workers start: it takes longer than the rest of the engine, and one process needs none.
"""

from __future__ import annotations

import atexit
import logging
import os
import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from multiprocessing import current_process, parent_process, resource_tracker
from multiprocessing.util import Finalize
from typing import Any

from collalign.engine.command_line import ENDING, can_be_answered
from collalign.engine.worker import end_with_parent

#: What joblib warns of where it replaces a worker whose memory has grown, or that waited for long: nothing is lost.
_REPLACED = "A worker stopped while some jobs were given to the executor"
#: Descriptors that the pool of workers opens, and for each of them.
_OF_POOL, _OF_WORKER = 16, 2


def can_start_workers() -> bool:
    """Return whether joblib starts workers here: not in daemons, and not below threads of its own."""
    if current_process().daemon or threading.current_thread() is threading.main_thread():
        return not current_process().daemon
    from joblib.parallel import get_active_backend

    return bool(get_active_backend()[0].nesting_level == 0)


@contextmanager
def lasting_workers() -> Iterator[None]:
    """Let worker processes wait for further tasks within this block; they end with the outermost one.

    joblib would keep them for five minutes after the last answer.
    """
    with _BLOCKS.lock:
        _BLOCKS.num_open += 1
    try:
        yield
    finally:
        with _BLOCKS.lock:
            _BLOCKS.num_open -= 1
            if _BLOCKS.num_open == 0 and _BLOCKS.has_workers:
                _BLOCKS.has_workers = False
                _dismiss_workers()


class _Blocks:
    """How many blocks of :func:`lasting_workers` are open in this process, in any thread."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.num_open = 0
        self.has_workers = False


_BLOCKS = _Blocks()


def on_workers(calls: Iterable[Any], num_jobs: int) -> Generator[Any]:
    """Run calls that joblib has delayed, and yield what they return, in any order.

    One job still means a worker process: joblib's own one-job mode isolates nothing.
    """
    from joblib import Parallel

    limited: dict[str, Any] = {"pre_dispatch": 1} if num_jobs == 1 else {}
    pool = Parallel(
        n_jobs=max(2, num_jobs),
        backend="loky",
        return_as="generator_unordered",
        max_nbytes=None,
        initializer=end_with_parent,
        initargs=(os.getpid(),),
        **limited,
    )
    if not _BLOCKS.has_workers:
        _require_descriptors(num_jobs)
    _BLOCKS.has_workers = True
    # A thread that outlives every context warns.
    warnings.filterwarnings("ignore", _REPLACED, UserWarning)
    if parent_process() is not None:
        _end_idle_workers_at_exit()
    with _uninterrupted():
        return pool(calls)


@cache
def _end_idle_workers_at_exit() -> None:
    """Dismiss idle workers at the end of this process; a child of ``multiprocessing`` would wait for them."""
    Finalize(None, _dismiss_workers, exitpriority=0)


def worker_pids() -> set[int]:
    """Return the process ids of the workers of this process that have not been waited for."""
    from joblib.externals.loky import reusable_executor

    executor = reusable_executor._executor
    return set() if executor is None else {*executor._processes.copy()}


def _dismiss_workers() -> None:
    from joblib.executor import MemmappingExecutor
    from joblib.externals.loky import reusable_executor

    executor = (
        reusable_executor._executor
    )  # asking for it would make a new one where a worker has died
    if not isinstance(executor, MemmappingExecutor):
        return
    executor.terminate(kill_workers=True)
    if (
        parent_process() is not None
    ):  # a child of ``multiprocessing`` ends without what joblib left to ``atexit``
        finalizers: dict[str, Callable[[], None]] = executor._temp_folder_manager._finalizers
        while finalizers:
            _, finalize = finalizers.popitem()
            atexit.unregister(finalize)
            finalize()


def _require_descriptors(num_jobs: int) -> None:
    """Raise the error of the system where workers need more descriptors than there are: joblib would do worse."""
    opened: list[int] = []
    try:
        for _ in range(_OF_POOL + _OF_WORKER * num_jobs):
            opened.append(os.open(os.devnull, os.O_RDONLY))
    finally:
        for descriptor in opened:
            os.close(descriptor)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Put interruptions off, and block in this thread what a terminal sends: what it starts inherits that.

    A terminal sends SIGINT and SIGHUP to all processes; each worker would print a traceback of its own, and so would
    one that is left half started, and the trackers of what they share.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from joblib.externals.loky.backend import resource_tracker as loky_tracker

    of_terminal = {signal.SIGINT, signal.SIGHUP}
    former = signal.pthread_sigmask(signal.SIG_BLOCK, of_terminal)
    try:
        for tracker in (loky_tracker, resource_tracker):
            tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, of_terminal)  # a tracker's start unblocks SIGINT
        with _put_off():
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


@contextmanager
def _put_off() -> Iterator[None]:
    """Keep an interruption for the end: any thread may receive it, and Python answers it in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    former = {
        number: signal.signal(number, lambda number, frame: came.append(number))
        for number in filter(can_be_answered, ENDING)
    }
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


@contextmanager
def silent_pool() -> Iterator[None]:
    """Keep quiet that a thread of the pool wanted to hand out a task when the pool had already been ended."""
    from joblib.externals.loky.process_executor import ShutdownExecutorError

    def says_something(record: logging.LogRecord) -> bool:
        return not (record.exc_info and isinstance(record.exc_info[1], ShutdownExecutorError))

    logger = logging.getLogger("concurrent.futures")
    logger.addFilter(says_something)
    try:
        yield
    finally:
        logger.removeFilter(says_something)
