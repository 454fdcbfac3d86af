"""What is concluded from deaths of workers and from the ledger, without any worker."""

import os
import threading
import time

import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError

from collalign.engine.local_jobs import _LocalRun
from collalign.engine.worker import Call, Guard, Task, describe, run_guarded
from data_tools.errors import InputError

TASK = Task(token=7, key="a", payload=3)


def call_of(function, **limits):
    return Call(function=function, **limits)


class DeadlyRun(_LocalRun):
    """A run whose workers all die of the same cause, after they have started the task or before."""

    def __init__(self, directory, cause, *, has_started):
        super().__init__(call_of(abs), Guard(directory=directory), 1)
        self.cause, self.has_started, self.num_calls = cause, has_started, 0

    def _parallel(self, *_):
        self.num_calls += 1
        if self.has_started:
            self._guard.note("S", TASK.token)
        raise TerminatedWorkerError(f"The exit codes of the workers are {{{self.cause}}}")


def test_deaths_before_the_task_has_started_are_not_its_own(tmp_path):
    run = DeadlyRun(tmp_path, "SIGSEGV(-11)", has_started=False)
    assert run._alone(TASK).crashed
    assert run.num_calls == 10


def test_only_tasks_of_the_ledger_that_go_on_or_that_nobody_takes_end_a_worker(
    tmp_path, monkeypatch
):
    guard, killed, ended = Guard(directory=tmp_path), [], threading.Event()
    run = _LocalRun(call_of(abs, time_limit_s=60.0), guard, 2)
    own, other = os.getpid(), 2**22 + 1

    def kill(pid, number):
        killed.append(pid)
        ended.set()

    for name, seconds in (("_WATCH_EVERY_S", 0.01), ("_GRACE_S", 0.05), ("_START_S", 0.1)):
        monkeypatch.setattr(f"collalign.engine.local_jobs.{name}", seconds)
    monkeypatch.setattr("collalign.engine.local_jobs.worker_pids", lambda: {own, other})
    monkeypatch.setattr("os.kill", kill)

    def watch_for(seconds):
        killed.clear()
        ended.clear()
        timer = threading.Timer(seconds, ended.set)
        timer.start()
        run._watch(0.1, ended)
        timer.cancel()
        timer.join()
        return {*killed}

    def watch_twice():
        """Return the seconds between the first kill and the next one of the same worker."""
        times = []

        def kill_and_note(pid, number):
            times.append(time.monotonic())
            if len(times) == 4:
                ended.set()

        ended.clear()
        with monkeypatch.context() as patch:
            patch.setattr("os.kill", kill_and_note)
            run._watch(0.1, ended)
        return times[2] - times[0]

    assert watch_for(0.5) == set(), "nothing in flight"
    run._in_flight = lambda: {7}
    assert watch_for(60.0) == {own, other}, "nobody takes it"
    assert watch_twice() > 0.15, "those that follow have their own time"
    guard.note("S", 7)
    assert watch_for(60.0) == {own}, "it goes on"
    assert run._cause_of_death(own, RuntimeError()) == "ran past the time limit of 60 s"
    guard.note("E", 7)
    assert watch_for(0.5) == set(), "it has ended"
    guard.note("S", 8)
    assert watch_for(0.5) == set(), "nobody waits for it"


@pytest.mark.parametrize("function", [abs, int.from_bytes])
def test_the_ledger_says_that_a_task_started_and_ended_however_it_did(tmp_path, function):
    guard = Guard(directory=tmp_path)
    outcome = run_guarded(call_of(function, time_limit_s=60.0), TASK, guard)
    assert (outcome.failure is None) == (function is abs)
    assert [line.split()[:2] for line in guard.ledger.read_text().splitlines()] == [
        ["S", "7"],
        ["E", "7"],
    ]
    assert _LocalRun(call_of(abs), guard, 1)._started_and_not_ended() == {}


def test_expected_errors_are_told_as_they_are_and_others_with_their_place():
    assert describe(InputError("a\n.ply:  truncated")) == "a\\n.ply: truncated"
    assert describe(ValueError("no")) == "ValueError: no"
