"""joblib on one machine, guarded: a dead worker's task is found in the ledger, the others go on in fresh workers."""

from __future__ import annotations

import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from itertools import chain

from collalign.engine.local_pool import lasting_workers, on_workers, silent_pool, worker_pids
from collalign.engine.worker import Call, Guard, Outcome, Task, crash, run_guarded
from data_tools.errors import CollalignError
from data_tools.io.temporary import TemporaryFolder

#: Deaths of its worker after which a task is given up; somebody else may have ended it: a person, a system short of
#: memory, a batch system.
_MAX_DEATHS = 3
#: Deaths in a row, before any task started, after which workers count as unable to start.
_MAX_STALLS = 10
#: How often the ledger is looked at.
_WATCH_EVERY_S = 1.0
#: Past the limit of time, until a worker is ended from outside that does not end itself, and until all are that take
#: no task: they may take long to start.
_GRACE_S, _START_S = 5.0, 60.0
#: In the place of a task's token: no worker takes one.
_NOBODY = -1


def run_local(call: Call, tasks: Iterator[Task], *, num_jobs: int) -> Generator[Outcome]:
    """Run tasks on worker processes of this machine; see :func:`collalign.engine.run_jobs.run_jobs`.

    A dead worker ends joblib's whole call. The tasks that had started but not ended are suspects; the rest goes on in
    fresh workers, and the suspects run at the end, one at a time, where a second death is theirs beyond doubt.
    """
    with lasting_workers(), TemporaryFolder() as directory, silent_pool():
        run = _LocalRun(call, Guard(directory=directory), num_jobs)
        with run.watched():
            yield from run.rounds(tasks)
            yield from run.suspects_alone()


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
        watch = threading.Thread(target=self._watch, args=(limit_s, ended), daemon=True)
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
            in_flight = self._in_flight()
            try:
                is_open, done = self._ledger()
            except OSError:  # for instance too many open files, for a moment
                continue
            seen = [one for one in is_open.items() if one[0] in in_flight]
            if not seen and in_flight - done:  # who is stopped may hold the lock of the queue
                seen = [(_NOBODY, len(done))]
            now_s = time.monotonic()
            since = {one: since.get(one, now_s) for one in seen}
            late = {
                (token, pid)
                for token, pid in seen
                if now_s - since[token, pid]
                > limit_s + (_START_S if token == _NOBODY else _GRACE_S)
            }
            if late:
                self._end_workers({pid for token, pid in late if token != _NOBODY})
                since.clear()  # those that follow have their own time

    def _end_workers(self, pids: set[int]) -> None:
        """Kill these workers, or all where none is named."""
        self._overdue |= pids
        workers = worker_pids()
        for pid in workers & pids if pids else workers:
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
        """Start one joblib call."""
        from joblib import delayed

        run: Callable[..., Outcome] = delayed(run_guarded)
        return on_workers((run(self._call, task, self._guard) for task in tasks), num_jobs)

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
