"""A session computes what its store lacks, keeps results and failures, and counts what it found there."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import pytest

from collalign.engine.jobs.run import JobResult
from collalign.engine.options import RunOptions
from collalign.engine.session import Session
from collalign.engine.store.store import Store
from data_tools.errors import InputError, SolveFailed
from tests.job_functions import misbehave


def root(value: float) -> dict[str, float]:
    if value < 0:
        raise InputError("negative")
    return {"root": value**0.5}


TASKS = {"a": ("one", 1.0), "b": ("four", 4.0), "c": ("bad", -1.0)}


def session_around(store: Store) -> Session[None]:
    return Session.around(store, None, RunOptions(jobs=1))


def test_results_and_failures_are_kept_and_not_computed_again() -> None:
    with Store.memory() as store:
        first = session_around(store)
        failures = first.compute("measurements", root, TASKS, time_limit_s=None)
        assert {key: failure.reason for key, failure in failures.items()} == {"c": "negative"}
        assert store.require("measurements", "b") == {"root": 2.0}
        assert first.num_reused("measurements", TASKS) == 0
        second = session_around(store)
        assert second.num_reused("measurements", ["a", "b", "c", "a"]) == 3
        store.put("measurements", "a", {"root": 7.0})
        assert second.compute("measurements", root, TASKS, time_limit_s=None).keys() == {"c"}
        assert store.require("measurements", "a") == {"root": 7.0}
        with second.shared_table("measurements", ["b", "a", "b"]) as table:
            assert sorted(table) == ["a", "b"]


def test_a_strict_session_raises_and_keeps_what_is_finished() -> None:
    with Store.memory() as store:
        with pytest.raises(InputError, match="bad: negative"):
            session_around(store).compute("measurements", root, TASKS, time_limit_s=None, strict=True)
        assert store.keys("measurements") == {"a", "b"}


def test_a_session_opens_its_own_store_and_hands_on_other_options() -> None:
    with Session.open("asked", RunOptions(jobs=1)) as session:
        decided = session.with_options("decided")
        assert (session.options, decided.options) == ("asked", "decided")
        assert decided.store is session.store


@pytest.mark.parametrize("num_jobs", [1, 2])
def test_results_are_spread_counted_and_not_kept(num_jobs: int) -> None:
    counted: list[str] = []

    def count(kind: str, total: int, done: int) -> AbstractContextManager[Callable[[JobResult], None]]:
        counted.append(f"{kind}: {done} of {total}")
        return nullcontext(lambda result: counted.append(result.key))

    with Session.open(None, RunOptions(jobs=num_jobs), count) as session:
        found = session.spread("things", misbehave, {str(i): ("return", i) for i in range(6)})
        assert session.spread("things", misbehave, {}) == {}
        assert not any(session.store.keys(kind) for kind in ("shapes", "pairs"))
    assert found == {str(i): i for i in range(6)}
    assert counted[0] == "things: 0 of 6"
    assert sorted(counted[1:]) == sorted(found)


def test_a_failure_is_an_error_that_names_the_task() -> None:
    with Session.open(None, RunOptions(jobs=1)) as session, pytest.raises(SolveFailed, match="things, b: ValueError"):
        session.spread("things", misbehave, {"a": ("return", 1), "b": ("raise", 2)})


def test_displays_say_when_all_is_done_and_count_steps_without_workers() -> None:
    shown: list[str] = []
    counted: list[JobResult] = []

    def display(description: str, total: int, *, done: int) -> AbstractContextManager[Callable[[JobResult], None]]:
        shown.append(f"{description}: {done} of {total}")
        return nullcontext(counted.append)

    with Store.memory() as store:
        session = Session.around(store, None, RunOptions(jobs=1), display)
        with session.alone("poses", 2) as advance:
            advance()
            advance()
        session.expecting(300.0).spread("pairs again", root, {"a": 1.0})
        session.enter("outputs")
        with session.expecting(7.2).alone("poses"):
            pass
        assert store.notes() == {"stage": "outputs"}
        with session_around(store).alone("poses") as advance:  # without a display nothing happens
            advance()
    assert len(counted) == 3
    assert shown == [
        "poses: 0 of 2",
        "pairs again (report in about 5 min): 0 of 1",
        "poses (report in about 7 s): 0 of 1",
    ]
