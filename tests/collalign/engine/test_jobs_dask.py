import asyncio
import logging
import os
import signal
import threading
from concurrent.futures import CancelledError
from contextlib import nullcontext

import pytest

from collalign import AlignOptions, RunOptions, align_collection
from collalign.engine.run_jobs import run_jobs
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import CollalignError
from data_tools.options import SamplingOptions
from tests.finished_runs import chairs
from tests.job_functions import misbehave, spectrum
from tests.optional import optional_module

distributed, dask = optional_module("distributed"), optional_module("dask")


@pytest.fixture(scope="module")
def cluster():
    options = {
        "n_workers": 2,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": ":0",
    }
    timeouts = {f"distributed.comm.timeouts.{name}": "60s" for name in ("connect", "tcp")}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1, **timeouts}),
        distributed.LocalCluster(silence_logs=logging.CRITICAL, **options) as cluster,
        pytest.MonkeyPatch.context() as patch,
    ):
        for name in ("_CONNECT_TIMEOUT_S", "_ANSWER_TIMEOUT_S"):
            patch.setattr(f"collalign.engine.dask_cluster.{name}", 60.0)
        done = threading.Event()
        replacing = threading.Thread(target=replace_lost_workers, args=(cluster, done))
        replacing.start()
        yield cluster
        done.set()
        replacing.join()


def replace_lost_workers(cluster, done):
    """Do what a queue of jobs does: Dask gives a worker up that dies before it has told its nanny that it runs."""
    while not done.wait(1.0):
        cluster.scale(2)


def kill_one_worker(cluster):
    os.kill(next(worker.pid for worker in cluster.workers.values() if worker.pid), signal.SIGKILL)


@pytest.mark.parametrize(
    "error",
    [
        asyncio.CancelledError(),
        CancelledError(),
        OSError("gone"),
        UnboundLocalError("result"),
        TimeoutError(),
    ],
)
def test_results_that_are_lost_on_their_way_are_asked_for_again(error, cluster, monkeypatch):
    ask, lost = distributed.Future.result, iter(range(3))

    def lose_three(future, *arguments, **options):
        if next(lost, None) is not None:
            raise error
        return ask(future, *arguments, **options)

    monkeypatch.setattr(distributed.Future, "result", lose_three)
    tasks = [(str(i), ("return", i)) for i in range(20)]
    results = list(run_jobs(misbehave, tasks, scheduler=cluster.scheduler_address))
    assert sorted(result.value for result in results) == list(range(20))
    assert next(lost, None) is None


def test_tasks_that_kill_workers_cost_only_themselves(cluster):
    tasks = [(f"r{i}", ("return", i)) for i in range(20)]
    tasks[3:3] = [("raise", ("raise", 1)), ("segfault", ("segfault", 1)), ("fill", ("fill", 1))]
    limits = {"time_limit_s": 300.0, "memory_limit_bytes": 2**31}
    results = {
        one.key: one
        for one in run_jobs(misbehave, tasks, scheduler=cluster.scheduler_address, **limits)
    }
    assert results.keys() == dict(tasks).keys()
    assert all(results[f"r{i}"].value == i for i in range(20))
    assert {key for key, result in results.items() if result.failure} == {
        "raise",
        "segfault",
        "fill",
    }
    # Memory is about the machine: another run may succeed.
    assert {key for key, result in results.items() if result.crashed} == {"segfault", "fill"}


def test_a_cluster_with_other_versions_is_refused(cluster, monkeypatch):
    monkeypatch.setattr("collalign.engine.dask_cluster._version", lambda package: "0.0")
    with pytest.raises(CollalignError, match="same versions"):
        list(run_jobs(spectrum, [("a", 1)], scheduler=cluster.scheduler_address))


def test_a_collection_is_the_same_after_a_worker_was_killed(cluster, tmp_path):
    write_collection(tmp_path, chairs(4))
    options = AlignOptions(group="SO", sampling=SamplingOptions(num_points=16, num_dense_points=0))
    kinds = []

    def progress(kind, total, *, done=0):
        def report(job):
            if kind == "pairs" and kind not in kinds:
                kill_one_worker(cluster)
            kinds.append(kind)

        return nullcontext(report)

    local = align_collection(tmp_path, options=options, run=RunOptions(jobs=1))
    run = RunOptions(scheduler=cluster.scheduler_address)
    distributed_result = align_collection(tmp_path, options=options, run=run, progress=progress)
    assert kinds.count("pairs") == 6
    assert distributed_result.transforms.tobytes() == local.transforms.tobytes()
    assert not distributed_result.excluded
