"""Many independent tasks on worker processes: results stream, and a task that kills its worker costs only itself.

The engine is joblib on one machine and Dask on several; both run :func:`collalign.engine.worker.run_guarded`.
What a task returns depends on its payload alone: BLAS has one thread in every mode, and nothing tells a task its
place in the order. So one process, two workers and a cluster of the same machines give the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any

from collalign.engine.job import SharedTable
from collalign.engine.local_jobs import run_local
from collalign.engine.local_pool import can_start_workers
from collalign.engine.worker import Call, Outcome, Task, run_in_process
from data_tools.errors import OptionsError

__all__ = ["Outcome", "SharedTable", "run_jobs"]


def run_jobs(
    function: Callable[..., Any],
    tasks: Iterable[tuple[str, Any]],
    *,
    num_jobs: int = 1,
    scheduler: str | None = None,
    shared: SharedTable | None = None,
    progress: Callable[[Outcome], None] | None = None,
    **limits: Any,
) -> Generator[Outcome]:
    """Run ``function`` on every task and yield each result as soon as it is there, in no particular order.

    Parameters
    ----------
    function : callable
        Of a module, so that workers can import it; called as ``function(payload)``, or ``function(payload, shared)``
        where there is a table. It must depend on nothing else.
    tasks : iterable of (key, payload)
        Keys are unique strings. Drawn as workers become free, so it may be long and lazy. Payloads travel with each
        task: keep them small, and put what many tasks need into ``shared``.
    num_jobs : int
        Worker processes on this machine; ignored with a ``scheduler``. With 1 and no limits the tasks run inside this
        process, where nothing isolates a crash. With 1 and a limit they run in a worker process, one at a time: a
        hang or an exhausted memory cannot be ended from inside. Where joblib starts no workers (daemons, its own
        threads), tasks run inside this process without limits.
    scheduler : str, optional
        Address of a Dask scheduler, ``tcp://host:port``; its workers need the same versions installed.
    shared : SharedTable, optional
        Records that tasks look up by key; sent once per machine, or per Dask worker, and read on demand.
    progress : callable, optional
        Called with each result, for instance a :class:`collalign.engine.progress.ProgressBar`.
    **limits
        Of each task, ``time_limit_s`` and ``memory_limit_bytes``, see :class:`collalign.engine.worker.Call`.

    Yields
    ------
    Outcome
        One per task. An exception in ``function`` is a failure, so is a task that ends its worker twice (a worker
        killed from outside may be the task's third). Other tasks are never lost.

    Raises
    ------
    OptionsError
        If the number of processes or a limit is impossible.
    CollalignError
        If workers cannot be started at all.
    """
    if num_jobs < 1:
        raise OptionsError(f"num_jobs: expected at least 1, got {num_jobs}")
    call = Call(function=function, table=shared, **limits)
    numbered = (
        Task(token=token, key=key, payload=payload) for token, (key, payload) in enumerate(tasks)
    )
    return _stream(_outcomes(call, numbered, num_jobs, scheduler), progress)


def _outcomes(
    call: Call, tasks: Iterator[Task], num_jobs: int, scheduler: str | None
) -> Generator[Outcome]:
    if scheduler is not None:
        from collalign.engine.dask_jobs import run_dask  # an optional dependency

        return run_dask(call, tasks, scheduler=scheduler)
    if (num_jobs == 1 and not call.is_limited) or not can_start_workers():
        return (run_in_process(call, task) for task in tasks)
    return run_local(call, tasks, num_jobs=num_jobs)


def _stream(
    outcomes: Generator[Outcome], progress: Callable[[Outcome], None] | None
) -> Generator[Outcome]:
    try:
        for outcome in outcomes:
            if progress is not None:
                progress(outcome)
            yield outcome
    finally:
        outcomes.close()
