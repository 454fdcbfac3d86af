"""Where worker processes start, and when they end."""

import os
import time
import warnings

import pytest
from joblib.externals.loky import process_executor

from collalign.engine.job import Job, Wanted
from collalign.engine.local_pool import lasting_workers
from collalign.engine.run_jobs import run_jobs
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from tests.faults import is_running
from tests.job_functions import process_id

TASKS = [(str(i), i) for i in range(3)]


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
