"""Where worker processes start, and when they end."""

import os
import subprocess
import sys
import time
import warnings
from multiprocessing import get_context
from pathlib import Path

import pytest
from joblib import Parallel, delayed
from joblib.externals.loky import process_executor

from collalign.engine.job import Job, Wanted
from collalign.engine.local_pool import lasting_workers
from collalign.engine.run_jobs import run_jobs
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from tests.faults import is_running
from tests.job_functions import process_id

ROOT = Path(__file__).resolve().parents[3]
TASKS = [(str(i), i) for i in range(3)]
#: In a child of a pool that is no daemon; what joblib leaves is said by a process that outlives both.
CHILD = """
from concurrent.futures import ProcessPoolExecutor
from tests.collalign.engine.test_jobs_workers import process_ids
if __name__ == "__main__":
    with ProcessPoolExecutor(1) as pool:
        print(len(list(pool.map(process_ids, [2]))))
"""


def process_ids(num_jobs=2):
    return {
        outcome.value
        for outcome in run_jobs(process_id, TASKS, num_jobs=num_jobs, time_limit_s=60.0)
    }


def process_record(payload):
    return {"pid": process_id(payload)}


def pids_of_session(run):
    job = Job(
        kind="shapes", version="pid", run=process_record, reader=lambda record, name: record["pid"]
    )
    wanted = {key: Wanted(key=key, label=key, arguments={"payload": value}) for key, value in TASKS}
    with Session.open(None, run) as session:
        return {*session.compute(job, wanted, time_limit_s=60.0).values()}


def test_workers_end_with_the_answer():
    assert not [pid for pid in process_ids() if is_running(pid)]
    with lasting_workers():
        first = process_ids()
        assert any(is_running(pid) for pid in first)
        assert process_ids() & first, "the same workers go on"
    assert not [pid for pid in first if is_running(pid)]


@pytest.mark.usefixtures("two_cores")
def test_one_job_starts_no_worker_unless_there_is_one_core_alone(monkeypatch):
    me = os.getpid()
    assert pids_of_session(RunOptions(jobs=1)) == {me}
    assert me not in pids_of_session(RunOptions(jobs=2))
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")
    assert me not in pids_of_session(RunOptions()), "limits hold where nobody asked for one process"


@pytest.mark.filterwarnings("error::UserWarning")
def test_where_joblib_starts_no_workers_tasks_run_without_a_warning():
    with get_context("spawn").Pool(1) as pool:  # of daemons
        assert len(pool.map(_quiet_process_ids, [2])[0]) == 1
    found = Parallel(n_jobs=2, backend="threading")(delayed(process_ids)(2) for _ in range(2))
    assert found == [{os.getpid()}] * 2


def _quiet_process_ids(num_jobs):
    import warnings

    warnings.simplefilter("error", UserWarning)
    return process_ids(num_jobs)


def grow(payload):
    """Let this worker look as if it had grown by more than joblib allows; it looks once a second."""
    process_executor._MAX_MEMORY_LEAK_SIZE = -(2**60)
    time.sleep(1.1)
    return os.getpid()


def test_a_worker_that_has_grown_is_replaced_without_a_warning():
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        pids = [
            outcome.value for outcome in run_jobs(grow, [(str(n), n) for n in range(6)], num_jobs=2)
        ]
    assert len(pids) == 6
    assert len({*pids}) > 2, "workers were replaced"
    assert not [str(one.message) for one in said]


def test_a_child_process_leaves_nothing_that_joblib_warns_of():
    done = subprocess.run(
        [sys.executable, "-W", "always::UserWarning", "-c", CHILD],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "1\n"
    assert "Warning" not in done.stderr
