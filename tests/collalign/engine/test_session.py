"""A session computes what its store lacks, keeps results and failures, and counts what it found there."""

from contextlib import nullcontext
from dataclasses import dataclass, replace

import pytest

from collalign.engine.job import Job, Wanted
from collalign.engine.local_pool import lasting_workers
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.engine.store import Store
from data_tools.errors import InputError, SolveFailed
from tests.job_functions import misbehave


@pytest.fixture(autouse=True, scope="module")
def workers():
    """Worker processes that all tests share."""
    with lasting_workers():
        yield


def root(value):
    if value < 0:
        raise InputError("negative")
    return {"root": value**0.5}


def whole(record, name):
    return record


JOB = Job(kind="measurements", version="1", run=root, reader=whole)
WANTED = {
    name: Wanted(key=key, label=name, arguments={"value": value})
    for key, name, value in (
        ("a", "one", 1.0),
        ("b", "four", 4.0),
        ("c", "bad", -1.0),
        ("b", "four again", 4.0),
    )
}


def session_around(store):
    return Session.around(store, None, RunOptions(jobs=1))


def test_results_and_failures_are_kept_and_not_computed_again():
    with Store.memory() as store:
        first = session_around(store)
        found = first.compute(JOB, WANTED, time_limit_s=None)
        assert found.failures == {"bad": "negative"}
        assert dict(found) == {
            "one": {"root": 1.0},
            "four": {"root": 2.0},
            "four again": {"root": 2.0},
        }
        assert (len(found), "bad" in found, "nobody" in found) == (3, False, False)
        with pytest.raises(KeyError):
            found["bad"]
        assert first.num_reused("measurements", "abc") == 0
        second = session_around(store)
        assert second.num_reused("measurements", ["a", "b", "c", "a"]) == 3
        store.put("measurements", "a", {"root": 7.0})
        again = second.compute(JOB, WANTED, time_limit_s=None)
        assert again.failures.keys() == {"bad"}
        assert again["one"] == {"root": 7.0}


def test_nothing_begins_once_the_time_is_over_and_the_store_knows_nothing_of_it():
    with Store.memory() as store:
        session = session_around(store)
        found = session.compute(JOB, WANTED, time_limit_s=None, until=0.0)
        assert (len(found), set(found.failures.values())) == (0, {"no time was left"})
        assert not store.failures("measurements")
        assert len(session.compute(JOB, WANTED, time_limit_s=None)) == 3


@dataclass(frozen=True)
class Root:
    root: float


@dataclass(frozen=True)
class Sum:
    total: float


def add(root, others, more):
    return Sum(total=root.root + sum(other.root for other in others) + more)


@pytest.mark.parametrize("num_jobs", [1, 2])
def test_results_of_one_job_are_arguments_of_another(num_jobs):
    job = replace(JOB, reader=Root)
    adding = Job(kind="evidence", version="1", run=add, reader=Sum)
    with Session.open(None, RunOptions(jobs=num_jobs)) as session:
        roots = session.compute(job, WANTED, time_limit_s=None)
        arguments = {
            "root": roots.shared("one"),
            "others": (roots.shared("four"), roots.shared("four")),
            "more": 0.5,
        }
        sums = session.compute(
            adding, {"all": Wanted(key="s", label="all", arguments=arguments)}, time_limit_s=None
        )
        assert sums["all"] == Sum(total=5.5)
        assert session.map_parallel("sums", add, {(1, 2): arguments}) == {(1, 2): Sum(total=5.5)}
        assert session.store.require("evidence", "s") == {"total": 5.5}


def test_a_strict_session_raises_and_keeps_what_is_finished():
    with Store.memory() as store:
        with pytest.raises(InputError, match="bad: negative"):
            session_around(store).compute(JOB, WANTED, time_limit_s=None, strict=True)
        assert store.keys("measurements") == {"a", "b"}


def test_a_session_opens_its_own_store():
    with Session.open("asked", RunOptions(jobs=1)) as session:
        assert session.options == "asked"
        assert session.store.path is None


@pytest.mark.parametrize("num_jobs", [1, 2])
def test_results_are_spread_counted_and_not_kept(num_jobs):
    counted = []

    def count(kind, total, done):
        counted.append(f"{kind}: {done} of {total}")
        return nullcontext(lambda result: counted.append(result.key))

    with Session.open(None, RunOptions(jobs=num_jobs), count) as session:
        found = session.map_parallel(
            "things", misbehave, {i: {"payload": ("return", i)} for i in range(6)}
        )
        assert session.map_parallel("things", misbehave, {}) == {}
        assert not any(session.store.keys(kind) for kind in ("shapes", "pairs"))
    assert found == {i: i for i in range(6)}
    assert counted[0] == "things: 0 of 6"
    assert sorted(counted[1:]) == sorted(map(str, found))


def test_a_failure_is_an_error_that_names_the_task():
    with (
        Session.open(None, RunOptions(jobs=1)) as session,
        pytest.raises(SolveFailed, match="things, b: ValueError"),
    ):
        session.map_parallel(
            "things", misbehave, {"a": {"payload": ("return", 1)}, "b": {"payload": ("raise", 2)}}
        )
