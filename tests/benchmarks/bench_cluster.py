"""What a cluster would make of a large collection: ``python -m tests.benchmarks.bench_cluster [--num 300]``.

Aligns generated chairs in this process, on one thread, and counts by kind of job the tasks, their processor seconds
and the bytes that travel with them, and what is left to the parent alone. Then it measures what Dask costs on this
machine: tasks that do nothing, and a table of shared records sent to two workers. From both it prints how long a
larger collection would take on more and more workers, all in proportion to the number of shapes. What is not measured
is the network: ``--bytes-per-s`` is what the scheduler's machine sends (1.25e9 is ten gigabits).
"""

import argparse
import hashlib
import logging
import pickle
import tempfile
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import collalign
import collalign.engine.session as session_module
import collalign.output.shape_files as shape_files
from collalign.engine.jobs import run as jobs_run
from collalign.engine.jobs.run import JobResult, SharedTable, run_jobs
from collalign.engine.jobs.worker import Limits
from tests.benchmarks.bench_scale import generate
from tests.job_functions import nothing

WORKERS = (2, 16, 64, 256)
#: Shapes that are aligned first, uncounted.
NUM_FIRST = 8
#: Work that does not grow with the collection: the pilot looks at so many shapes, sheet and overview show so many.
CONSTANT = ("chirality_energies", "write_document")
#: Tasks of a message: of jobs whose results are kept, and of many short ones.
KEPT, BATCH, LARGE_BATCH = ("sample_file", "match_pair"), 8, 64
#: Tasks that do nothing, and the records of a table of 40 MB.
NUM_EMPTY, NUM_RECORDS = 2000, 1000


@dataclass
class Kind:
    """What tasks of one kind took in all."""

    num: float = 0.0
    seconds: float = 0.0
    sent_bytes: float = 0.0
    table_bytes: float = 0.0


class Counter:
    """Stands for ``run_jobs`` and counts."""

    def __init__(self) -> None:
        self.kinds: dict[str, Kind] = {}
        self._sent = set[bytes]()

    def __call__(
        self, function: Callable[..., Any], tasks: Any, shared: SharedTable | None = None, **options: Any
    ) -> Generator[JobResult]:
        kind = self.kinds.setdefault(getattr(function, "run", function).__name__, Kind())
        if shared is not None:
            content = shared.path.read_bytes()
            digest = hashlib.sha256(content).digest()
            kind.table_bytes += len(content) * (digest not in self._sent)  # equal tables go out once
            self._sent.add(digest)

        def counted() -> Iterator[tuple[str, Any]]:
            for key, payload in tasks:
                kind.sent_bytes += len(pickle.dumps((key, payload), protocol=5))
                yield key, payload

        for job in run_jobs(function, counted(), num_jobs=1, shared=shared):
            kind.num += 1
            kind.seconds += job.seconds
            kind.sent_bytes += len(pickle.dumps(job, protocol=5))
            yield job


def measure(num: int) -> tuple[dict[str, Kind], float]:
    """Return the work of the workers by kind, and the seconds of the parent alone, for so many generated shapes."""
    counter = Counter()
    time.perf_counter = time.process_time  # tasks are timed by it
    jobs_run.Limits = lambda **ignored: Limits()  # type: ignore[assignment,misc]  # no limits: no worker processes
    session_module.run_jobs = shape_files.run_jobs = counter  # type: ignore[assignment]
    with tempfile.TemporaryDirectory() as folder:
        generate(num, Path(folder) / "shapes", 0)
        start_s = time.process_time()
        run = collalign.RunOptions(jobs=1, store=Path(folder) / "store.sqlite")
        collalign.align_collection(Path(folder) / "shapes", run=run).save(Path(folder) / "out")
        total_s = time.process_time() - start_s
    return counter.kinds, total_s - sum(kind.seconds for kind in counter.kinds.values())


@contextmanager
def cluster() -> Iterator[Any]:
    """Start a scheduler in this process and two workers."""
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with LocalCluster(**options) as running:
        yield running


def dask_costs() -> tuple[float, float]:
    """Return the seconds of scheduler and parent for each message, and for each byte of a table to each worker."""
    rng = np.random.default_rng(0)
    table = ((str(i), {"positions": rng.standard_normal(5000)}) for i in range(NUM_RECORDS))
    with cluster() as running, SharedTable.create(table) as shared:
        address = running.scheduler_address
        list(run_jobs(nothing, [("first", 0)], scheduler=address))
        start_s = time.process_time()
        tasks = [(str(i), i) for i in range(NUM_EMPTY)]
        list(run_jobs(nothing, tasks, scheduler=address, batch_size=BATCH))
        message_s = (time.process_time() - start_s) / NUM_EMPTY * BATCH
        start_s = time.process_time()
        list(run_jobs(nothing, [("one", 0)], scheduler=address, shared=shared))
        byte_s = (time.process_time() - start_s) / (2 * shared.path.stat().st_size)
    return message_s, byte_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num", type=int, default=300)
    parser.add_argument("--plan", type=int, default=10_000)
    parser.add_argument("--bytes-per-s", type=float, default=1.25e9)
    arguments = parser.parse_args()
    message_s, byte_s = dask_costs()
    measure(NUM_FIRST)  # imports everything
    print(f"The scheduler: {1e3 * message_s:.1f} ms for each message, {1e-6 / byte_s:.0f} MB/s of tables")
    kinds, alone_s = measure(arguments.num)
    factor = arguments.plan / arguments.num
    print(
        f"{arguments.num} shapes, for {arguments.plan} times {factor:.1f}; the parent alone {factor * alone_s:.0f} s"
    )
    for name, kind in kinds.items():
        kind.num, kind.seconds = (value * (1.0 if name in CONSTANT else factor) for value in (kind.num, kind.seconds))
        print(
            f"  {name:18} {kind.num:8.0f} tasks of {1e3 * kind.seconds / max(kind.num, 1):6.1f} ms, in all "
            f"{kind.seconds:5.0f} s, {factor * kind.sent_bytes / 1e6:6.0f} MB with the tasks, "
            f"{factor * kind.table_bytes / 1e6:4.0f} MB of tables for each worker",
            flush=True,
        )
    for num_workers in (1, *WORKERS):
        messages = {name: kind.num / (BATCH if name in KEPT else LARGE_BATCH) for name, kind in kinds.items()}
        tasks_s = sum(max(kind.seconds / num_workers, messages[name] * message_s) for name, kind in kinds.items())
        tables = factor * num_workers * sum(kind.table_bytes for kind in kinds.values())
        tables_s = tables * max(1.0 / arguments.bytes_per_s, byte_s)
        parts = f"tasks {tasks_s:.0f} s, parent alone {factor * alone_s:.0f} s, tables {tables_s:.0f} s"
        print(
            f"{num_workers:4} workers: {(tasks_s + factor * alone_s + tables_s) / 60:.1f} min ({parts})", flush=True
        )


if __name__ == "__main__":
    main()
