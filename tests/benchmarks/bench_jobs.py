"""What jobs and store cost beside the tasks, and what two workers gain: ``python -m tests.benchmarks.bench_jobs``.

Times depend on the machine and its load; the ratios are what matters. Each line is the best of three runs.
"""

from __future__ import annotations

import argparse
import importlib.util
import logging
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from collalign.engine.jobs.run import run_jobs
from collalign.engine.store.records import Record
from collalign.engine.store.store import Store
from tests.job_functions import spectrum


def busy(payload: tuple[int, float]) -> Record:
    """Compute for a given time, and return a record of the size of a pair's."""
    seed, seconds = payload
    end = time.perf_counter() + seconds
    vectors = spectrum(seed)
    while time.perf_counter() < end:
        spectrum(seed)
    return {"vectors": vectors}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=200)
    parser.add_argument("--seconds", type=float, nargs="+", default=[0.01, 0.05])
    options = parser.parse_args()
    for seconds in options.seconds:
        tasks = [(f"{i:040x}", (i, seconds)) for i in range(options.tasks)]
        own_s = options.tasks * seconds
        print(f"{options.tasks} tasks of {seconds * 1e3:g} ms:")
        serial_s = best(lambda: run(tasks, num_jobs=1))  # noqa: B023
        print(f"  one process: {100 * (serial_s / own_s - 1):.1f} % overhead of jobs and store")
        isolated_s = best(lambda: run(tasks, num_jobs=1, time_limit_s=60.0, memory_limit_bytes=2**32))  # noqa: B023
        print(f"  one guarded worker: {100 * (isolated_s / own_s - 1):.1f} % overhead")
        two_s = best(lambda: run(tasks, num_jobs=2, time_limit_s=60.0, memory_limit_bytes=2**32))  # noqa: B023
        print(
            f"  two guarded workers: {isolated_s / two_s:.2f} x one guarded worker, "
            f"{own_s / two_s:.2f} x the tasks alone"
        )
        if importlib.util.find_spec("distributed"):
            print(f"  two Dask workers: {own_s / dask_time(tasks):.2f} x the tasks alone")


def best(measure: Callable[[], float]) -> float:
    return min(measure() for _ in range(3))


def run(tasks: list[tuple[str, tuple[int, float]]], **options: object) -> float:
    """Run the tasks into a store, with workers that have started already; returns seconds."""
    with tempfile.TemporaryDirectory() as folder, Store.open(Path(folder) / "store") as store:
        list(run_jobs(busy, tasks[:2], **options))  # type: ignore[arg-type]
        start_s = time.perf_counter()
        for job in run_jobs(busy, tasks, **options):  # type: ignore[arg-type]
            store.put("pairs", job.key, job.value, seconds=job.seconds)
        return time.perf_counter() - start_s


def dask_time(tasks: list[tuple[str, tuple[int, float]]]) -> float:
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with LocalCluster(**options) as cluster:
        return best(lambda: run(tasks, scheduler=cluster.scheduler_address))


if __name__ == "__main__":
    main()
