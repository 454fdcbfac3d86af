"""One stage of a run: the jobs whose results the store lacks, each kept as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, TypeAlias

from collalign.engine.jobs.run import JobResult, SharedTable, run_jobs
from collalign.engine.store.store import Store
from collalign.options import RunOptions
from data_tools.errors import InputError

#: Makes a progress display from (description, total, done): :class:`collalign.engine.jobs.progress.ProgressBar`.
ProgressFactory: TypeAlias = Callable[..., AbstractContextManager[Callable[[JobResult], None]]]


def run_stage(
    kind: str,
    function: Callable[..., Any],
    tasks: Mapping[str, tuple[str, Any]],
    store: Store,
    run: RunOptions,
    *,
    time_limit_s: float,
    strict: bool = False,
    shared: SharedTable | None = None,
    progress: ProgressFactory | None = None,
) -> None:
    """Compute what the store lacks and put every result into it.

    Parameters
    ----------
    kind : {"shapes", "pairs"}
    function : callable
        Of a module; see :func:`collalign.engine.jobs.run.run_jobs`.
    tasks : mapping of key to (label, payload)
        All that the run wants.
    store : Store
    run : RunOptions
    time_limit_s : float
        Per task.
    strict : bool
        Raise at the first failure; what is finished stays in the store.
    shared : SharedTable, optional
    progress : callable, optional
        Makes the progress display.

    Raises
    ------
    InputError
        With ``strict``, at the first failure.
    """
    store.plan(kind, {key: label for key, (label, _) in tasks.items()})
    missing = store.missing(kind, tasks, retry="all" if strict else "crashed")
    num_done = len(tasks) - len(missing)
    display = progress(kind, len(tasks), done=num_done) if progress and missing else nullcontext()
    with display as report:
        jobs = run_jobs(
            function,
            ((key, tasks[key][1]) for key in missing),
            num_jobs=run.num_workers,
            time_limit_s=time_limit_s,
            memory_limit_bytes=run.memory_limit_bytes,
            scheduler=run.scheduler,
            shared=shared,
            progress=report,
        )
        for job in jobs:
            label = tasks[job.key][0]
            if job.failure is None:
                store.put(kind, job.key, job.value, label=label, seconds=job.seconds)
                continue
            store.put_failure(kind, job.key, job.failure, label=label, crashed=job.crashed)
            if strict:
                jobs.close()
                raise InputError(f"{label}: {job.failure}")
