import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from collalign.engine.progress import ProgressBar
from collalign.engine.run_jobs import SharedTable, run_jobs
from data_tools.errors import CollalignError, InputError, OptionsError
from tests.faults import is_running
from tests.job_functions import look_up, misbehave, positions, process_id, spectrum

ROOT = Path(__file__).resolve().parents[3]
SPECTRA = [(f"s{seed}", seed) for seed in range(12)]


def collect(*arguments, **options):
    results = list(run_jobs(*arguments, **options))
    assert len({result.key for result in results}) == len(results)
    return {result.key: result for result in results}


def test_serial_workers_and_any_order_give_the_same_bytes():
    serial = {key: result.value.tobytes() for key, result in collect(spectrum, SPECTRA).items()}
    runs = [
        collect(spectrum, SPECTRA, num_jobs=2),
        collect(spectrum, SPECTRA[::-1], num_jobs=2),
        collect(spectrum, SPECTRA, num_jobs=1, time_limit_s=60.0),
    ]
    for run in runs:
        assert {key: result.value.tobytes() for key, result in run.items()} == serial
    assert len(set(serial.values())) == len(SPECTRA)


def meet_another(folder):
    """Wait until two processes were here, and return which this one is."""
    (folder / str(os.getpid())).touch()
    deadline = time.monotonic() + 60.0
    while len(list(folder.iterdir())) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    return os.getpid()


def test_no_limits_and_one_job_stay_in_this_process_and_a_limit_leaves_it(tmp_path):
    tasks = [(str(i), i) for i in range(8)]
    assert {result.value for result in collect(process_id, tasks).values()} == {os.getpid()}
    isolated = {result.value for result in collect(process_id, tasks, time_limit_s=60.0).values()}
    assert os.getpid() not in isolated
    meetings = [(str(i), tmp_path) for i in range(8)]
    met = {result.value for result in collect(meet_another, meetings, num_jobs=2).values()}
    assert len(met) == 2


def test_results_stream_and_tasks_are_drawn_as_workers_become_free():
    drawn = []

    def tasks():
        for i in range(400):
            drawn.append(i)
            yield str(i), i

    results = run_jobs(process_id, tasks(), num_jobs=2)
    next(results)
    assert len(drawn) < 40
    results.close()


def test_tasks_that_misbehave_cost_only_themselves(tmp_path):
    tasks = [(f"r{i}", ("return", i)) for i in range(40)]
    for place, action in ((3, "raise"), (15, "segfault"), (21, "hang"), (27, "fill")):
        tasks.insert(place, (action, (action, 7)))
    tasks.insert(33, ("killed-once", ("killed-once", str(tmp_path / "killed"))))
    results = collect(misbehave, tasks, num_jobs=2, time_limit_s=2.5, memory_limit_bytes=2**31)
    assert results.keys() == dict(tasks).keys()
    assert all(results[f"r{i}"].value == i for i in range(40))
    assert results["killed-once"].value == str(tmp_path / "killed")
    failures = {
        key: result.failure for key, result in results.items() if result.failure is not None
    }
    assert failures.keys() == {"raise", "segfault", "hang", "fill"}
    reasons = {
        "raise": "no answer for 7",
        "segfault": "SIGSEGV",
        "hang": "time limit of 2.5 s",
        "fill": "MemoryError",
    }
    assert all(reason in str(failures[key]) for key, reason in reasons.items())
    assert {key for key in failures if results[key].crashed} == {"segfault", "hang", "fill"}
    assert np.isnan(results["hang"].seconds)
    assert results["r0"].seconds >= 0.01


def test_a_worker_that_is_stopped_is_ended_and_its_task_runs_again(tmp_path):
    tasks = [(f"r{i}", ("return", i)) for i in range(20)]
    tasks.insert(3, ("stopped", ("stopped-once", str(tmp_path / "stopped"))))
    results = collect(misbehave, tasks, num_jobs=2, time_limit_s=2.5)
    assert {result.failure for result in results.values()} == {None}
    assert results["stopped"].value == str(tmp_path / "stopped")


def test_failures_are_records_in_one_process_too():
    results = collect(misbehave, [("a", ("raise", 1)), ("b", ("return", 2))])
    assert results["a"].failure is not None
    assert results["a"].failure.startswith(
        "ValueError: no answer for 1 (in misbehave, tests/job_functions.py:"
    )
    assert results["b"].value == 2


@pytest.mark.parametrize("num_jobs", [1, 2])
def test_an_error_of_the_task_list_itself_is_raised(num_jobs):
    def tasks():
        yield "a", ("return", 1)
        yield "b", ("return", 2)
        raise InputError("no more")

    with pytest.raises(InputError, match="no more"):
        collect(misbehave, tasks(), num_jobs=num_jobs)


def test_no_tasks_give_no_results():
    assert collect(spectrum, [], num_jobs=2) == {}


def test_workers_that_cannot_start_a_task_end_the_run(monkeypatch):
    import collalign.engine.local_jobs

    monkeypatch.setattr(collalign.engine.local_jobs, "run_guarded", _die_before_the_ledger)
    monkeypatch.setattr(collalign.engine.local_jobs, "_MAX_STALLS", 2)
    with pytest.raises(CollalignError, match=r"die before they start a task.*EXIT\(9\)"):
        collect(spectrum, SPECTRA, num_jobs=2)


def _die_before_the_ledger(*arguments):
    os._exit(9)


def test_workers_end_when_their_parent_is_killed():
    script = (
        "from collalign.engine.run_jobs import run_jobs\n"
        "from tests.job_functions import process_id\n"
        "for result in run_jobs(process_id, ((str(i), i) for i in range(100000)), num_jobs=2):\n"
        "    print(result.value, flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        workers = {int(process.stdout.readline()) for _ in range(20)}
        os.kill(process.pid, signal.SIGKILL)
    assert_gone(workers)


def assert_gone(processes):
    deadline = time.monotonic() + 300.0
    while any(is_running(pid) for pid in processes) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(is_running(pid) for pid in processes)


@pytest.mark.parametrize("num_jobs", [1, 2])
def test_shared_records_are_looked_up_by_key(num_jobs):
    records = ((str(i), {"positions": np.full((4, 3), float(i))}) for i in range(300))
    with SharedTable.create(records) as table:
        results = collect(
            look_up, [(f"{i}", str(i)) for i in range(300)], num_jobs=num_jobs, shared=table
        )
        assert all(result.value == 12.0 * int(key) for key, result in results.items())
        with pytest.raises(KeyError):
            table.made("missing", positions)
        with pytest.raises(ValueError, match="read-only"):
            table.made("3", positions)[0] = 1.0
        path = table.path
    assert not path.exists()


def test_a_table_that_cannot_be_written_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with SharedTable.create([("a", {"f": 1})]) as table:
        assert table.path.is_relative_to(tmp_path)
    with pytest.raises(TypeError):
        SharedTable.create([("a", {"f": print})])
    assert list(tmp_path.iterdir()) == []


def test_progress_is_told_of_every_result():
    text = io.StringIO()
    with ProgressBar("pairs", 6, done=2, file=text) as progress:
        collect(
            misbehave,
            [("a", ("return", 1)), ("b", ("raise", 1)), ("c", ("return", 1))],
            progress=progress,
        )
        progress.advance()
    assert "6/6" in text.getvalue()
    assert "failed=1" in text.getvalue()


def test_impossible_limits_are_refused():
    wrong = [
        ("time_limit_s", 0.0),
        ("time_limit_s", np.nan),
        ("time_limit_s", np.inf),
        ("memory_limit_bytes", 5),
    ]
    for limit in (*wrong, ("num_jobs", 0)):
        with pytest.raises(OptionsError):
            run_jobs(spectrum, SPECTRA, **dict([limit]))
