"""Dask on several machines, by plain futures: a killed worker's tasks run again, a task that kills runs alone.

Dask replaces dead workers and repeats their tasks by itself; after several deaths it gives a task up together with
innocent ones that ran at the same time. So these suspects run one at a time at the end. A table of shared records
goes to each worker once, as a worker plugin, which later and restarted workers get as well (scattered data would be
lost with its holder), and goes when the run ends.
"""

from __future__ import annotations

import hashlib
from collections.abc import Generator, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias

from collalign.engine.dask_cluster import Cluster, Future, KilledWorker, WorkerPlugin
from collalign.engine.job import SharedTable
from collalign.engine.worker import Call, Outcome, Task, crash, run_guarded
from data_tools.errors import CollalignError, RunLost

#: Batches submitted ahead for each core of the cluster.
_AHEAD_PER_CORE = 2
#: Times that a batch is submitted again after Dask lost or cancelled it, or its worker had no table yet.
_MAX_RESUBMISSIONS = 10
#: Without a result for so long, the scheduler is asked whether it is still there.
_PATIENCE_S = 2.0
#: Tasks per message: each costs the scheduler 4 ms.
_BATCH = 8

Batch: TypeAlias = tuple[Task, ...]


def run_dask(call: Call, tasks: Iterator[Task], *, scheduler: str) -> Generator[Outcome]:
    """Run tasks on a Dask cluster; see :func:`collalign.engine.run_jobs.run_jobs`.

    Raises
    ------
    OptionsError
        If the address is none.
    RunLost
        If nobody answers at it, no worker joins, or the scheduler or all workers are lost meanwhile.
    CollalignError
        If the workers have other versions installed or cannot run the tasks.
    """
    with Cluster.connect(scheduler) as cluster:
        run = _DaskRun(cluster, call)
        yield from run.batches(iter(lambda: tuple(islice(tasks, _BATCH)), ()))
        yield from run.suspects_alone()
        run.withdraw()


class TableMissing(RuntimeError):
    """A worker joined before the plugin with the shared records reached it."""


class TablePlugin(WorkerPlugin):  # type: ignore[misc]  # its types are not looked at
    """Gives a worker the shared records: writes them to its local disk and opens them there.

    Parameters
    ----------
    name : str
        Of the table.
    data : bytes
        The file of a :class:`~collalign.engine.job.SharedTable`.
    """

    def __init__(self, name: str, data: bytes) -> None:
        self.name = name
        self.data = data

    def setup(self, worker: Any) -> None:
        """Write the table; Dask calls this once for each worker."""
        path = Path(worker.local_directory) / f"{self.name}.table"
        path.write_bytes(self.data)
        _TABLES[self.name] = SharedTable(path)

    def teardown(self, worker: Any) -> None:
        """Remove the table from the worker."""
        table = _TABLES.pop(self.name, None)
        if table is not None:
            table.close()
            table.path.unlink(missing_ok=True)


_TABLES: dict[str, SharedTable] = {}


def run_share(call: Call, table_name: str | None, batch: Batch) -> list[Outcome]:
    """Run a batch on a Dask worker.

    Raises
    ------
    TableMissing
        If the worker has no table of that name.
    """
    if table_name is not None:
        if table_name not in _TABLES:
            raise TableMissing(table_name)
        call = replace(call, table=_TABLES[table_name])
    return [run_guarded(call, task, None) for task in batch]


class _DaskRun:
    """The state of one run on a cluster."""

    def __init__(self, cluster: Cluster, call: Call) -> None:
        self._cluster = cluster
        self._plugin = None if call.table is None else _plugin_for(call.table)
        self._call = replace(call, table=None)
        self._ended: SimpleQueue[Future] = SimpleQueue()
        self._suspects: list[Task] = []
        self._resubmissions: dict[int, int] = {}  # by the first task's token
        self._publish()

    def batches(self, batches: Iterator[Batch]) -> Generator[Outcome]:
        """Run all batches, a few ahead of the workers, and yield outcomes as they come."""
        in_flight: dict[str, tuple[Future, Batch]] = {}

        def submit(batch: Batch) -> None:
            future = self._submit(batch)
            in_flight[future.key] = future, batch

        for batch in islice(batches, self._ahead()):
            submit(batch)
        while in_flight:
            future, batch = in_flight.pop(self._next_ended().key)
            outcomes = self._result(future, batch)
            if outcomes is None:
                submit(batch)
                continue
            for following in islice(batches, max(0, self._ahead() - len(in_flight))):
                submit(following)
            yield from outcomes

    def suspects_alone(self) -> Generator[Outcome]:
        """Run the tasks of batches that Dask gave up one at a time; a second time is a recorded failure."""
        suspects, self._suspects = self._suspects, []
        for task in suspects:
            outcomes = None
            while outcomes is None:
                self._submit((task,))
                outcomes = self._result(self._next_ended(), (task,))
            if self._suspects:
                self._suspects.clear()
                reason = "ended every cluster worker that it ran on (crash, time or memory limit)"
                outcomes = [crash(task, reason)]
            yield from outcomes

    def _submit(self, batch: Batch) -> Future:
        name = None if self._plugin is None else self._plugin.name
        future = self._cluster.ask(
            self._cluster.client.submit, run_share, self._call, name, batch, pure=False
        )
        future.add_done_callback(self._ended.put)
        return future

    def _next_ended(self) -> Future:
        """Wait for a batch to end, and look after the cluster where that takes long."""
        while True:
            try:
                return self._ended.get(timeout=_PATIENCE_S)
            except Empty:
                self._cluster.check()

    def _result(self, future: Future, batch: Batch) -> list[Outcome] | None:
        """Return the outcomes of a batch, none of them if it became suspect, or None if it has to run again."""
        try:
            outcomes: list[Outcome] = self._cluster.ask(future.result)
            return outcomes
        except KilledWorker:
            self._suspects.extend(batch)
            return []
        except TableMissing:
            self._publish()
            problem = "a worker never got the shared records"
        except RunLost:  # or only the worker that held them, and they are computed again
            self._cluster.check()
            problem = "results do not come back from the workers in time"
        except CancelledError:
            self._cluster.check()
            problem = "the scheduler lost or cancelled the tasks again and again"
        except CollalignError:
            raise
        except Exception as error:
            self._cluster.check()
            if future.status == "error":  # raised on the worker, not on the way from it
                raise CollalignError(
                    f"the cluster cannot run the tasks: {type(error).__name__}: {error}"
                ) from error
            problem = f"results do not come back from the workers ({type(error).__name__})"
        first = batch[0].token
        self._resubmissions[first] = self._resubmissions.get(first, 0) + 1
        if self._resubmissions[first] > _MAX_RESUBMISSIONS:
            raise CollalignError(problem)
        return None

    def _publish(self) -> None:
        """Send the table to all workers, also where they should have it."""
        if self._plugin is None:
            return
        try:
            num_bytes = len(self._plugin.data) * self._cluster.num_cores()
            self._cluster.ask(
                self._cluster.client.register_plugin, self._plugin, num_bytes=num_bytes
            )
        except CollalignError:
            raise
        except (
            OSError,
            CancelledError,
        ):  # a worker died meanwhile; the scheduler has the plugin for its successor
            self._cluster.check()
        except Exception as error:
            self._cluster.check()
            raise CollalignError(
                f"the cluster cannot run this program: {type(error).__name__}: {error}"
            ) from error

    def withdraw(self) -> None:
        """Take the table from the workers, if they are still there."""
        if self._plugin is not None:
            with suppress(
                OSError, CollalignError
            ):  # a worker that dies meanwhile needs no cleaning
                self._cluster.ask(self._cluster.client.unregister_worker_plugin, self._plugin.name)

    def _ahead(self) -> int:
        return _AHEAD_PER_CORE * max(1, self._cluster.num_cores())


def _plugin_for(table: SharedTable) -> TablePlugin:
    data = table.path.read_bytes()
    return TablePlugin(f"collalign-{hashlib.sha256(data).hexdigest()[:16]}", data)
