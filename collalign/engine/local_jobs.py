"""joblib on one machine, guarded: a dead worker's task is found in the ledger, the others go on in fresh workers.

joblib is imported where workers start: it takes longer than the rest of the engine, and one process needs none.
"""

from __future__ import annotations

import atexit
import logging
import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache
from itertools import chain
from multiprocessing import current_process, parent_process, resource_tracker
from multiprocessing.util import Finalize
from typing import Any

from collalign.engine.command_line import ENDING, can_be_answered
from collalign.engine.worker import (
    Call,
    Guard,
    Outcome,
    Task,
    crash,
    end_with_parent,
    run_guarded,
)
from data_tools.errors import CollalignError
from data_tools.io.temporary import TemporaryFolder

#: Deaths of its worker after which a task is given up; somebody else may have ended it: a person, a system short of
#: memory, a batch system.
_MAX_DEATHS = 3
#: Deaths in a row, before any task started, after which workers count as unable to start.
_MAX_STALLS = 10
#: How often the ledger is looked at, and after which time past the limit workers are ended from outside: they end
#: themselves in time unless they are stopped, and may take long to start.
_WATCH_EVERY_S, _GRACE_S = 1.0, 60.0
#: In the place of a task's token: no worker takes one.
_NOBODY = -1
#: Descriptors that the pool of workers opens, and for each of them.
_OF_POOL, _OF_WORKER = 16, 2
#: What joblib warns of where it replaces a worker whose memory has grown, or that waited for long: nothing is lost.
_REPLACED = "A worker stopped while some jobs were given to the executor"


def run_local(call: Call, tasks: Iterator[Task], *, num_jobs: int) -> Generator[Outcome]:
    """Run tasks on worker processes of this machine; see :func:`collalign.engine.run_jobs.run_jobs`.

    A dead worker ends joblib's whole call. The tasks that had started but not ended are suspects; the rest goes on in
    fresh workers, and the suspects run at the end, one at a time, where a second death is theirs beyond doubt.
    """
    with lasting_workers(), TemporaryFolder() as directory, _silent_pool():
        run = _LocalRun(call, Guard(directory=directory), num_jobs)
        with run.watched():
            yield from run.rounds(tasks)
            yield from run.suspects_alone()


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


class _Round:
    """Feeds one joblib call with tasks, and remembers those whose result has not come back."""

    def __init__(self, tasks: Iterator[Task]) -> None:
        self._tasks = tasks
        self._lock = threading.Lock()  # joblib draws tasks from several threads
        self._closed = False
        self._error: Exception | None = None
        self._in_flight: dict[int, Task] = {}

    def __iter__(self) -> Iterator[Task]:
        return self

    def __next__(self) -> Task:
        with self._lock:
            if self._closed:
                raise StopIteration
            try:
                task = next(self._tasks)
            except StopIteration:
                raise
            except Exception as error:  # joblib would wait for ever
                self._error, self._closed = error, True
                raise StopIteration from None
            self._in_flight[task.token] = task
            return task

    def received(self, token: int) -> None:
        with self._lock:
            del self._in_flight[token]

    def tokens(self) -> set[int]:
        """Return the tasks in flight."""
        with self._lock:
            return {*self._in_flight}

    def close(self) -> list[Task]:
        """Give out no more tasks, and return those in flight; raise what the caller's own iterator raised."""
        with self._lock:
            self._closed = True
            if self._error is not None:
                raise self._error
            return list(self._in_flight.values())


class _LocalRun:
    """The state of one run: which tasks are suspects, and how often each lost its worker."""

    def __init__(self, call: Call, guard: Guard, num_jobs: int) -> None:
        self._call = call
        self._guard = guard
        self._num_jobs = num_jobs
        self._suspects: dict[int, Task] = {}
        self._in_flight: Callable[[], set[int]] = set
        self._overdue: set[int] = set()  # process ids of workers that were ended from here

    @contextmanager
    def watched(self) -> Iterator[None]:
        """End workers that do not end themselves in time: one that is stopped (SIGSTOP) runs no watchdog."""
        limit_s = self._call.time_limit_s
        if limit_s is None:
            yield
            return
        ended = threading.Event()
        watch = threading.Thread(target=self._watch, args=(limit_s + _GRACE_S, ended), daemon=True)
        watch.start()
        try:
            yield
        finally:
            ended.set()
            watch.join()

    def _watch(self, limit_s: float, ended: threading.Event) -> None:
        """Look into the ledger again and again: at tasks that go on, and at tasks that no worker takes."""
        since: dict[tuple[int, int], float] = {}
        while not ended.wait(_WATCH_EVERY_S):
            is_open, done = self._ledger()
            seen = [one for one in is_open.items() if one[0] not in self._suspects]
            if not seen and self._in_flight() - done:
                seen = [
                    (_NOBODY, len(done))
                ]  # workers that are stopped may hold the lock of the queue
            now_s = time.monotonic()
            since = {one: since.get(one, now_s) for one in seen}
            late = {one for one in seen if now_s - since[one] > limit_s}
            workers = _worker_pids() if late else set()
            late_pids = {pid for token, pid in late if token != _NOBODY}
            self._overdue |= late_pids
            for pid in workers & late_pids if late_pids else workers:
                with suppress(ProcessLookupError):
                    os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))

    def rounds(self, tasks: Iterator[Task]) -> Generator[Outcome]:
        """Run everything but suspects, in as many joblib calls as deaths demand."""
        stalls = 0
        while True:
            feed = _Round(tasks)
            self._in_flight = feed.tokens
            try:
                with _closing(self._parallel(feed, self._num_jobs)) as outcomes:
                    for outcome in outcomes:
                        feed.received(outcome.token)
                        stalls = 0
                        yield outcome
                feed.close()
                return
            except BrokenProcessPool as error:
                lost = feed.close()
                started = self._started_and_not_ended()
                guilty = {task.token: task for task in lost if task.token in started}
                self._suspects.update(guilty)
                stalls = 0 if guilty else stalls + 1
                if stalls >= _MAX_STALLS:
                    raise CollalignError(
                        f"worker processes die before they start a task: {_cause(error)}"
                    ) from None
                tasks = chain((task for task in lost if task.token not in guilty), tasks)

    def suspects_alone(self) -> Generator[Outcome]:
        """Run the suspects one at a time, until each has a result or has ended too many workers."""
        for task in self._suspects.values():
            yield self._alone(task)

    def _alone(self, task: Task) -> Outcome:
        deaths, stalls = 1, 0
        while True:
            self._guard.ledger.unlink(missing_ok=True)
            self._in_flight = lambda: {task.token}
            try:
                (outcome,) = self._parallel(iter([task]), 1)
                return outcome
            except BrokenProcessPool as error:
                pid = self._started_and_not_ended().get(task.token)
                cause = _cause(error) if pid is None else self._cause_of_death(pid, error)
                if pid is None:
                    stalls += 1
                else:
                    deaths += 1
                if deaths >= _MAX_DEATHS or stalls >= _MAX_STALLS:
                    return crash(task, f"{cause}, {deaths} times in a row")

    def _parallel(self, tasks: Iterable[Task], num_jobs: int) -> Generator[Outcome]:
        """Start one joblib call. One job still means a worker process: joblib's own one-job mode isolates nothing."""
        from joblib import Parallel, delayed

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
        warnings.filterwarnings(
            "ignore", _REPLACED, UserWarning
        )  # of a thread that outlives every context
        if parent_process() is not None:
            _end_idle_workers_at_exit()
        run: Callable[..., Outcome] = delayed(run_guarded)
        with _uninterrupted():
            return pool(run(self._call, task, self._guard) for task in tasks)

    def _started_and_not_ended(self) -> dict[int, int]:
        """Return the worker's process id by token of the tasks that a death interrupted."""
        return self._ledger()[0]

    def _ledger(self) -> tuple[dict[int, int], set[int]]:
        """Return process ids by token of the tasks that have started and not ended, and the tasks that have ended."""
        try:
            text = self._guard.ledger.read_text(encoding="ascii")
        except FileNotFoundError:
            return {}, set()
        is_open, done = dict[int, int](), set[int]()
        for line in text.rpartition("\n")[0].splitlines():
            mark, token, pid = line.split()
            if mark == "S":
                is_open[int(token)] = int(pid)
            else:
                is_open.pop(int(token), None)
                done.add(int(token))
        return is_open, done

    def _cause_of_death(self, pid: int, error: BaseException) -> str:
        trace = self._guard.trace(pid)
        if pid in self._overdue or (trace.is_file() and trace.stat().st_size):
            return f"ran past the time limit of {self._call.time_limit_s:g} s"
        return _cause(error)


@cache
def _end_idle_workers_at_exit() -> None:
    """Dismiss idle workers at the end of this process; a child of ``multiprocessing`` would wait for them."""
    Finalize(None, _dismiss_workers, exitpriority=0)


def _worker_pids() -> set[int]:
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
def _silent_pool() -> Iterator[None]:
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


@contextmanager
def _closing(outcomes: Generator[Outcome]) -> Iterator[Generator[Outcome]]:
    """Close joblib's generator at the end, without its advice about results that the caller did not wait for."""
    try:
        yield outcomes
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            outcomes.close()


def _cause(error: BaseException) -> str:
    """Say how a worker ended, as far as joblib's message tells."""
    found = re.search(r"exit codes of the workers are \{(.*?)\}", str(error))
    return f"the worker process died ({found.group(1) if found else 'for an unknown reason'})"
