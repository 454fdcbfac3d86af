"""A run's session: what every stage shares, and the one way to compute, keep and report the jobs of a stage."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from collalign.engine.job import Job, K, Results, T, Wanted, run_task, table_of_stored
from collalign.engine.local_pool import lasting_workers
from collalign.engine.run_jobs import Outcome, SharedTable, run_jobs
from collalign.engine.run_options import RunOptions
from collalign.engine.store import Store
from collalign.engine.store_file import KINDS, STAGE
from data_tools.errors import InputError, SolveFailed

#: Makes a progress display from (description, total, done): :class:`collalign.engine.progress.ProgressBar`.
ProgressFactory: TypeAlias = Callable[..., AbstractContextManager[Callable[[Outcome], None]]]

OptionsT = TypeVar("OptionsT")

#: One step of what needs no worker, as a display counts it.
_STEP = Outcome(key="", value=None, failure=None, seconds=0.0)


def each_shown(items: Sequence[K], kind: str, progress: ProgressFactory | None) -> Iterator[K]:
    """Yield items that this process deals with by itself, and show how many are done."""
    with nullcontext() if progress is None else progress(kind, len(items), done=0) as report:
        for item in items:
            yield item
            if report is not None:
                report(_STEP)


@dataclass(frozen=True, kw_only=True, eq=False)
class Session(Generic[OptionsT]):
    """What the stages of one run share. Open it with :meth:`open`, or make one around an open store.

    Attributes
    ----------
    options : object
        What decides the result; the stages read it, the engine does not.
    run : RunOptions
        How the work is done.
    store : Store
        Keeps every result as soon as it is there.
    progress : callable or None
        Makes a progress display per stage.
    stored : mapping of kind to set of keys
        What the store held before this run.
    """

    options: OptionsT
    run: RunOptions
    store: Store
    progress: ProgressFactory | None
    stored: Mapping[str, frozenset[str]]

    @classmethod
    def around(
        cls,
        store: Store,
        options: OptionsT,
        run: RunOptions,
        progress: ProgressFactory | None = None,
    ) -> Session[OptionsT]:
        """Return a session on an open store."""
        stored = {kind: store.keys(kind) for kind in KINDS}
        return cls(options=options, run=run, store=store, progress=progress, stored=stored)

    @classmethod
    @contextmanager
    def open(
        cls, options: OptionsT, run: RunOptions, progress: ProgressFactory | None = None
    ) -> Iterator[Session[OptionsT]]:
        """Open the store that ``run`` names, one in memory without, for the length of a ``with`` block.

        Worker processes end with the block.

        Raises
        ------
        StoreError
            If the store is damaged or in use.
        """
        with lasting_workers(), Store.open(run.store) if run.store else Store.memory() as store:
            yield cls.around(store, options, run, progress)

    def enter(self, stage: str) -> None:
        """Note in the store what the run does now."""
        self.store.set_note(STAGE, stage)

    @contextmanager
    def alone(self, kind: str) -> Iterator[None]:
        """Show that this process does something by itself, as a stage of one step."""
        with nullcontext() if self.progress is None else self.progress(kind, 1, done=0) as report:
            yield
            if report is not None:
                report(_STEP)

    def num_reused(self, kind: str, keys: Iterable[str]) -> int:
        """Return for how many of the keys the store held a result before this run."""
        return sum(key in self.stored[kind] for key in keys)

    def compute(
        self,
        job: Job[T],
        wanted: Mapping[K, Wanted],
        *,
        time_limit_s: float | None,
        shared: SharedTable | None = None,
        again: bool = False,
        strict: bool = False,
        until: float = math.inf,
    ) -> Results[K, T]:
        """Compute what the store lacks, put every result into it, and return all of them.

        Parameters
        ----------
        job : Job
        wanted : mapping of any name to Wanted
            All that the run wants.
        time_limit_s : float or None
            Per task; None for neither this limit nor that of the memory, and so inside this process with one worker.
            With ``jobs=1`` there are no limits.
        shared : SharedTable, optional
            Where arguments are not of the store.
        again : bool
            Whether all failures of earlier runs are tried again, and not only those of the machine; so they are with
            ``strict``.
        strict : bool
            Raise at the first failure; what is finished stays in the store.
        until : float
            When, by :func:`time.monotonic`, no further task begins; what has not begun is among the failures of the
            results, not of the store. The first that are wanted begin first.

        Raises
        ------
        InputError
            With ``strict``, at the first failure.
        """
        by_key = {one.key: one for one in wanted.values()}
        self.store.plan(job.kind, {key: one.label for key, one in by_key.items()})
        missing = self.store.missing(job.kind, by_key, again=again or strict)
        own = (
            table_of_stored(self.store, (by_key[key].arguments for key in missing))
            if shared is None
            else None
        )
        with (
            nullcontext() if own is None else own,
            self._display(job.kind, len(by_key), len(missing)) as report,
        ):
            memory_bytes = None if time_limit_s is None else self.run.memory_limit_bytes
            outcomes = run_jobs(
                partial(run_task, job.run, True),
                takewhile(
                    lambda _: time.monotonic() < until,
                    ((key, by_key[key].arguments) for key in missing),
                ),
                num_jobs=self.run.num_workers,
                time_limit_s=None if self.run.is_alone else time_limit_s,
                memory_limit_bytes=None if self.run.is_alone else memory_bytes,
                scheduler=self.run.scheduler,
                shared=own if shared is None else shared,
                progress=report,
            )
            for outcome in outcomes:
                label = by_key[outcome.key].label
                self._keep(job.kind, label, outcome)
                if strict and outcome.failure is not None:
                    outcomes.close()
                    is_named = Path(outcome.failure.partition(": ")[0]).name == Path(label).name
                    raise InputError(outcome.failure if is_named else f"{label}: {outcome.failure}")
        done, failures = self.store.keys(job.kind), self.store.failures(job.kind)
        if unsettled := by_key.keys() - done - failures.keys():
            self.store.unplan(job.kind, unsettled)
        left = {name: failures.get(one.key) for name, one in wanted.items() if one.key not in done}
        reasons = {
            name: "no time was left" if failure is None else failure.reason
            for name, failure in left.items()
        }
        return Results(self.store, job, wanted, reasons)

    def map_parallel(
        self,
        kind: str,
        run: Callable[..., Any],
        tasks: Mapping[K, Mapping[str, Any]],
        *,
        shared: SharedTable | None = None,
    ) -> dict[K, Any]:
        """Compute results that are not kept, on all workers, and return them by name, in the order of the tasks.

        Parameters
        ----------
        kind : str
            What is counted, for the progress display.
        run : callable
            Of a module, as that of a :class:`collalign.engine.job.Job`; it is not expected to fail.
        tasks : mapping of any name to arguments
            As those of :class:`collalign.engine.job.Wanted`.
        shared : SharedTable, optional
            Where arguments are not of the store.

        Raises
        ------
        SolveFailed
            If a task fails nevertheless.
        """
        names, results = {str(name): name for name in tasks}, dict[K, Any]()
        own = table_of_stored(self.store, tasks.values()) if shared is None else None
        with (
            nullcontext() if own is None else own,
            self._display(kind, len(tasks), len(tasks)) as report,
        ):
            outcomes = run_jobs(
                partial(run_task, run, False),
                ((str(name), arguments) for name, arguments in tasks.items()),
                num_jobs=self.run.num_workers,
                scheduler=self.run.scheduler,
                shared=own if shared is None else shared,
                progress=report,
            )
            for outcome in outcomes:
                if outcome.failure is not None:
                    outcomes.close()
                    raise SolveFailed(f"{kind}, {outcome.key}: {outcome.failure}")
                results[names[outcome.key]] = outcome.value
        return {name: results[name] for name in tasks}

    def _display(
        self, kind: str, total: int, missing: int
    ) -> AbstractContextManager[Callable[[Outcome], None] | None]:
        if self.progress is None or not missing:
            return nullcontext()
        return self.progress(kind, total, done=total - missing)

    def _keep(self, kind: str, label: str, job: Outcome) -> None:
        if job.failure is None:
            self.store.put(kind, job.key, job.value, label=label, seconds=job.seconds)
        else:
            self.store.put_failure(kind, job.key, job.failure, label=label, crashed=job.crashed)
