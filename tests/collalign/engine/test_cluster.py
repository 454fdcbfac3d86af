"""Clusters that are not there, or go away in the middle: a message in good time, and nothing finished is lost."""

import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager, nullcontext

import pytest

from collalign import AlignOptions, RunOptions, align_collection
from collalign.engine.run_jobs import run_jobs
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import OptionsError, RunLost
from data_tools.options import SamplingOptions
from tests.finished_runs import chairs
from tests.job_functions import spectrum
from tests.optional import optional_module

optional_module("distributed")

#: What a user waits for a message at most.
PATIENCE_S = 30.0
OPTIONS = AlignOptions(group="SO", sampling=SamplingOptions(num_points=16, num_dense_points=0))


class OwnCluster:
    """A scheduler and perhaps a worker, in processes of their own."""

    def __init__(self, folder, *, with_worker):
        file = folder / "scheduler.json"
        self._log = (folder / "cluster.log").open("wb")
        port = free_port()
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = self._start(
            "scheduler", "--port", str(port), "--no-dashboard", "--scheduler-file", str(file)
        )
        self.worker = None
        if with_worker:
            flags = ("--nthreads", "1", "--no-dashboard", "--no-nanny", "--death-timeout", "60")
            self.worker = self._start("worker", "--scheduler-file", str(file), *flags)

    def kill_worker(self):
        if self.worker is not None:
            self.worker.kill()

    def _start(self, kind, *flags):
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *flags]
        return subprocess.Popen(command, stdout=self._log, stderr=self._log)

    def close(self):
        for process in (self.worker, self.scheduler):
            if process is not None:
                process.kill()
                process.wait()
        self._log.close()


class Answering:
    """A client of a scheduler that is there but slow."""

    status = "running"

    def slow(self):
        time.sleep(0.3)
        return 7


def test_what_sends_much_may_take_longer(monkeypatch):
    from collalign.engine import dask_cluster as module

    monkeypatch.setattr(module, "_ANSWER_TIMEOUT_S", 0.05)
    client = Answering()
    cluster = module.Cluster(client, "tcp://there:1")
    with pytest.raises(RunLost):
        cluster.ask(client.slow)
    assert cluster.ask(client.slow, num_bytes=300.0 * module._LEAST_BYTES_PER_S) == 7


@contextmanager
def own_cluster(folder, *, with_worker=True):
    cluster = OwnCluster(folder, with_worker=with_worker)
    try:
        yield cluster
    finally:
        cluster.close()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("cluster") / "chairs"
    write_collection(path, chairs(3))
    return path


def test_a_scheduler_that_hangs_or_dies_ends_the_run_in_good_time(tmp_path, monkeypatch):
    monkeypatch.setattr("collalign.engine.dask_cluster._ANSWER_TIMEOUT_S", 2.0)
    with own_cluster(tmp_path) as cluster:
        for number in (signal.SIGSTOP, signal.SIGKILL):
            results = run_jobs(
                spectrum, [(str(i), i) for i in range(300)], scheduler=cluster.address
            )
            assert next(results).failure is None
            cluster.scheduler.send_signal(number)
            hit_s = time.monotonic()
            with pytest.raises(RunLost, match="does not answer any more"):
                list(results)
            assert time.monotonic() - hit_s < PATIENCE_S
            cluster.scheduler.send_signal(signal.SIGCONT)


def test_without_workers_the_run_ends_and_what_is_finished_is_kept(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("collalign.engine.dask_cluster._WORKERLESS_END_S", 1.0)
    with own_cluster(tmp_path) as cluster:
        run = RunOptions(scheduler=cluster.address, store=tmp_path / "store.sqlite")

        def progress(kind, total, *, done=0):
            monkeypatch.setattr(
                "collalign.engine.dask_cluster._ANSWER_TIMEOUT_S", 2.0
            )  # of the next stage
            return nullcontext(lambda job: cluster.kill_worker())

        with pytest.raises(RunLost, match=r"has no workers|workers are gone|not answer"):
            align_collection(folder, options=OPTIONS, run=run, progress=progress)
    again = align_collection(folder, options=OPTIONS, run=RunOptions(jobs=1, store=run.store))
    alone = align_collection(folder, options=OPTIONS, run=RunOptions(jobs=1))
    assert again.run.num_reused == 3
    assert again.transforms.tobytes() == alone.transforms.tobytes()


@pytest.mark.parametrize(
    ("address", "error"),
    [
        ("garbage", OptionsError),
        ("", OptionsError),
        ("tcp://no.such.host.invalid:8786", RunLost),
        ("tcp://127.0.0.1:99999", OptionsError),
        ("tcp://127.0.0.1", OptionsError),
        ("nonsense://127.0.0.1:1", OptionsError),
        ("tcp://127.0.0.1:9", RunLost),
    ],
)
def test_addresses_without_a_scheduler_are_named(address, error, monkeypatch, capfd):
    monkeypatch.setattr("collalign.engine.dask_cluster._CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(error, match=address or "''"):
        list(run_jobs(spectrum, [("a", 1)], scheduler=address))
    assert "Traceback" not in capfd.readouterr().err


def test_another_program_at_the_address_is_no_scheduler(monkeypatch):
    monkeypatch.setattr("collalign.engine.dask_cluster._CONNECT_TIMEOUT_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(RunLost, match="no Dask scheduler answers"):
            list(run_jobs(spectrum, [("a", 1)], scheduler=address))
