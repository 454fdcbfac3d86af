"""What runs around a task inside a worker: a ledger, a time limit, a memory limit, one BLAS thread, no orphans."""

from __future__ import annotations

import faulthandler
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any

from collalign.engine.job import SharedTable
from collalign.engine.store_file import MAX_TEXT
from data_tools.errors import CollalignError, OptionsError, UnavailableError
from data_tools.io.locks import PRIVATE
from data_tools.threads import one_blas_thread

#: Errors that another run of the same task may not meet.
_OF_THE_MACHINE = (MemoryError, OSError, ImportError, UnavailableError)
_ORPHAN_POLL_S = 1.0


@dataclass(frozen=True, kw_only=True)
class Call:
    """What every task that workers run has in common, with its limits; None is no limit.

    Attributes
    ----------
    function : callable
    table : SharedTable or None
    time_limit_s : float, optional
        Seconds that a task may take; its worker is ended then, even where it holds the interpreter lock.
    memory_limit_bytes : int, optional
        Memory that a task may add to what its worker already has mapped (Linux).

    Raises
    ------
    OptionsError
        If a limit is impossible.
    """

    function: Callable[..., Any]
    table: SharedTable | None = None
    time_limit_s: float | None = None
    memory_limit_bytes: int | None = None

    @property
    def is_limited(self) -> bool:
        """Whether there is a limit."""
        return self.time_limit_s is not None or self.memory_limit_bytes is not None

    def __post_init__(self) -> None:
        seconds, num_bytes = self.time_limit_s, self.memory_limit_bytes
        if seconds is not None and not 0 < seconds < float("inf"):
            raise OptionsError(
                f"time_limit_s: expected a positive number of seconds or None, got {seconds}"
            )
        if num_bytes is not None and num_bytes < 2**20:
            raise OptionsError(
                f"memory_limit_bytes: expected at least 1 MiB or None, got {num_bytes}"
            )


@dataclass(frozen=True, kw_only=True)
class Task:
    """One task: ``token`` is its number in the run, ``key`` the caller's name for it."""

    token: int
    key: str
    payload: Any


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a task.

    Attributes
    ----------
    key : str
    value : Any
        What the function returned; None after a failure.
    failure : str or None
        Why there is no value.
    seconds : float
        Wall-clock time in the worker; NaN where it died.
    crashed : bool
        Whether another run may succeed: a worker died or hung on it, or what the function raised is about the machine
        (memory, a file that cannot be read now, a package) and not about the task.
    token : int
        The task's number.
    """

    key: str
    value: Any
    failure: str | None
    seconds: float
    crashed: bool = False
    token: int = -1


@dataclass(frozen=True, kw_only=True)
class Guard:
    """Where the parent looks after a death: the ledger of started and ended tasks, and the traces of hung ones.

    Attributes
    ----------
    directory : Path
        Of this run, on this machine.
    """

    directory: Path

    @property
    def ledger(self) -> Path:
        """Lines ``S token pid`` (started) and ``E token pid`` (ended), appended by all workers."""
        return self.directory / "ledger"

    def trace(self, pid: int) -> Path:
        """Return the file into which faulthandler writes when a task of that worker runs out of time."""
        return self.directory / f"{pid}.trace"

    def note(self, mark: str, token: int) -> None:
        """Append one line; short appends are atomic, so lines of several workers never mix."""
        descriptor = os.open(self.ledger, os.O_WRONLY | os.O_APPEND | os.O_CREAT | PRIVATE, 0o600)
        try:
            os.write(descriptor, f"{mark} {token} {os.getpid()}\n".encode())
        finally:
            os.close(descriptor)


def run_in_process(call: Call, task: Task) -> Outcome:
    """Run one task right here, with one BLAS thread and exceptions recorded, but without limits."""
    started = time.perf_counter()
    value, failure, crashed = None, None, False
    arguments = (task.payload,) if call.table is None else (task.payload, call.table)
    try:
        with one_blas_thread():
            value = call.function(*arguments)
    except Exception as error:
        failure, crashed = describe(error), isinstance(error, _OF_THE_MACHINE)
    seconds = time.perf_counter() - started
    return Outcome(
        key=task.key,
        value=value,
        failure=failure,
        seconds=seconds,
        crashed=crashed,
        token=task.token,
    )


def run_guarded(call: Call, task: Task, guard: Guard | None) -> Outcome:
    """Run one task inside a worker, within its limits.

    Parameters
    ----------
    call, task
        What to run.
    guard : Guard or None
        None where no parent on this machine looks at the ledger (Dask).
    """
    with _ONE_AT_A_TIME, ExitStack() as stack:
        if guard is not None:
            guard.note("S", task.token)
            stack.callback(guard.note, "E", task.token)
        stack.enter_context(_time_limit(call.time_limit_s, guard))
        stack.enter_context(_memory_limit(call.memory_limit_bytes))
        return run_in_process(call, task)


def crash(task: Task, reason: str) -> Outcome:
    """Return the outcome of a task that has ended its worker processes."""
    return Outcome(
        key=task.key,
        value=None,
        failure=reason,
        seconds=float("nan"),
        crashed=True,
        token=task.token,
    )


def describe(error: BaseException) -> str:
    """Return one line about an error: what it says, and for unexpected ones the type and the place."""
    text = " ".join(str(error).split())[:MAX_TEXT]
    if isinstance(error, CollalignError):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    place = ""
    if frames:
        last = frames[-1]
        place = f" (in {last.name}, {'/'.join(Path(last.filename).parts[-2:])}:{last.lineno})"
    return f"{type(error).__name__}: {text}{place}"


#: Limits belong to the process, so a worker with several threads (Dask) runs one task after the other.
_ONE_AT_A_TIME = threading.Lock()


@contextmanager
def _time_limit(seconds: float | None, guard: Guard | None) -> Iterator[None]:
    """End the process after so many seconds: a watchdog thread of C code, which needs no interpreter lock."""
    if seconds is None:
        yield
        return
    file = sys.__stderr__ if guard is None else _trace_file(guard)
    if file is None:
        file = open(os.devnull, "wb", buffering=0)  # noqa: SIM115
    faulthandler.dump_traceback_later(seconds, exit=True, file=file)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


_TRACE_FILES: dict[Path, FileIO] = {}


def _trace_file(guard: Guard) -> FileIO:
    path = guard.trace(os.getpid())
    if path not in _TRACE_FILES:
        for stale in _TRACE_FILES.values():
            stale.close()
        _TRACE_FILES.clear()
        _TRACE_FILES[path] = FileIO(str(path), "wb")
    return _TRACE_FILES[path]


@contextmanager
def _memory_limit(num_bytes: int | None) -> Iterator[None]:
    """Let the process map so many bytes more than it has; beyond that allocations fail, usually as MemoryError."""
    mapped = None if num_bytes is None else _mapped_bytes()
    if num_bytes is None or mapped is None:
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = mapped + num_bytes
    resource.setrlimit(
        resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard)
    )
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _mapped_bytes() -> int | None:
    """Return the size of this process's address space; None where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")


def end_with_parent(parent_pid: int, end: Callable[[], object] = lambda: os._exit(1)) -> None:
    """Start a thread that ends this process when its parent is gone; a worker does so before anything else.

    The parent is given by number because it may be gone already. Whether that number still runs would be the wrong
    question: a killed process that nobody has waited for does.

    Parameters
    ----------
    parent_pid : int
    end : callable
        Ends this process, at once by default.
    """
    threading.Thread(target=_wait_for_orphanhood, args=(parent_pid, end), daemon=True).start()


def _wait_for_orphanhood(parent_pid: int, end: Callable[[], object]) -> None:
    while os.getppid() == parent_pid:
        time.sleep(_ORPHAN_POLL_S)
    end()
