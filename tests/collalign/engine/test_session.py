"""A session computes what its store lacks, keeps results and failures, and counts what it found there."""

import pickle
from contextlib import nullcontext
from dataclasses import dataclass, replace

import pytest

from collalign.engine.job import Job, Wanted, table_of_stored, table_of_values
from collalign.engine.local_pool import lasting_workers
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session, each_shown
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


def record_fields(record, name):
    return sorted(record)


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


def test_a_table_holds_what_readers_ask_for_alone():
    with Store.memory() as store:
        for key in ("a", "b"):
            store.put("shapes", key, {"root": 1.0, "total": 2.0, "large": 3.0})
        root, total, whole = (
            {"x": replace(JOB, kind="shapes", reader=reader).shared("a")}
            for reader in (Root, Sum, record_fields)
        )
        every = ["large", "root", "total"]
        for tasks, expected in (
            ([root], ["root"]),
            ([root, total], ["root", "total"]),
            ([root, whole], every),
            ([whole, root], every),
        ):
            table = table_of_stored(store, tasks)
            assert table is not None
            with table:
                assert table.made("a", record_fields) == expected
                with pytest.raises(KeyError):
                    table.made("b", record_fields)
        assert table_of_stored(store, [{"x": 1.0}]) is None


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    value: float


def test_values_of_a_table_are_read_in_every_process():
    with table_of_values([Measured(value=2.0)]) as table:
        assert table.made("0", Measured).value == 2.0
        assert table.made("0", Measured) is table.made("0", Measured)
        assert table.made("0", record_fields) == ["value"]
        assert pickle.loads(pickle.dumps(table)).made("0", Measured).value == 2.0
        with pytest.raises(KeyError):
            table.made("1", Measured)


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


def test_displays_count_steps_without_workers():
    shown = []
    counted = []

    def display(description, total, *, done):
        shown.append(f"{description}: {done} of {total}")
        return nullcontext(counted.append)

    with Store.memory() as store:
        session = Session.around(store, None, RunOptions(jobs=1), display)
        with session.alone("poses"):
            assert counted == []
        assert len(counted) == 1
        session.map_parallel("pairs again", root, {"a": {"value": 1.0}})
        session.enter("outputs")
        assert store.notes() == {"stage": "outputs"}
        with session_around(store).alone("poses"):  # without a display nothing happens
            pass
    assert len(counted) == 2
    assert [len(counted) for _ in each_shown("abc", "specimens", display)] == [2, 3, 4]
    assert len(counted) == 5
    assert [*each_shown("abc", "specimens", None)] == ["a", "b", "c"]
    assert shown == ["poses: 0 of 1", "pairs again: 0 of 1", "specimens: 0 of 3"]
