"""Dataclasses come back from records as they were, and records that cannot be are refused."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import pytest
from numpy.typing import NDArray

from collalign.engine.records import decode, encode, fields_of, from_record, to_record
from collalign.stages.match_pairs import PairPoses, match_pair
from data_tools.arrays import Holds
from data_tools.errors import SolveFailed, StoreError
from pairwise import match
from pairwise.options import MatchOptions
from pairwise.results import Status
from tests.products import samples_at


def drawn(rng):
    """Return samples at random."""
    positions = rng.standard_normal((12, 3))
    return samples_at(positions - positions.mean(axis=0), invariants=rng.standard_normal((12, 2)))


def through_bytes(record):
    return decode(encode(record), "x")


@pytest.fixture
def poses(rng):
    return match_pair(drawn(rng), drawn(rng), "SO", MatchOptions())


def test_a_match_without_a_pose_is_a_failure_and_no_record(rng, monkeypatch):
    failed = replace(
        match(rng.random((4, 3)), rng.random((4, 3))), candidates=(), status=Status.FAILED
    )
    monkeypatch.setattr(
        "collalign.whole_pairs.match_whole.match_problem", lambda problem, options: failed
    )
    with pytest.raises(SolveFailed, match="No usable answer"):
        match_pair(drawn(rng), drawn(rng), "SO", MatchOptions())


@dataclass(frozen=True)
class Part:
    colour: str


@dataclass(frozen=True)
class Everything:
    name: str
    parts: tuple[Part, ...]
    maybe: Part | None
    status: Status
    blob: bytes
    share: float
    flags: Annotated[NDArray[np.bool_], Holds(shape="n")]
    weights: Annotated[NDArray[np.float32], Holds(shape="n? 2")]
    table: dict[str, NDArray[np.float64]]


def test_every_kind_of_field_comes_back_and_a_reader_takes_what_it_names():
    value = Everything(
        name="all",
        parts=(Part("red"), Part("blue")),
        maybe=None,
        status=Status.FAILED,
        blob=b"abc",
        share=0.5,
        flags=np.array([True, False]),
        weights=np.zeros((0, 2), dtype=np.float32),
        table={"a": np.ones(3)},
    )
    record = through_bytes(to_record(value))
    assert "name" not in record
    back = from_record(Everything, record | {"unknown": 1}, "all")
    assert (back.parts, back.maybe, back.status, back.blob) == (
        value.parts,
        None,
        Status.FAILED,
        b"abc",
    )
    assert back.weights.dtype == np.float32
    assert back.table["a"].tolist() == [1.0] * 3
    assert from_record(Everything, record | {"maybe": {"colour": "red"}}, "all").maybe == Part(
        "red"
    )
    assert fields_of(Part) == {"colour"}
    assert fields_of(lambda record, name: record) is None
    with pytest.raises(StoreError, match="'GOOD' is none"):
        from_record(Everything, record | {"status": "GOOD"}, "all")
    for change in (
        {"parts": [{"colour": 1}]},
        {"parts": "red"},
        {"maybe": []},
        {"blob": "abc"},
        {"share": float("nan")},
        {"flags": np.array([0, 2])},
        {"weights": np.zeros((1, 2), dtype=np.float32)},
        {"table": {"a": 1}},
    ):
        with pytest.raises(StoreError, match="all"):
            from_record(Everything, record | change, "all")


@pytest.mark.parametrize(
    "change",
    [
        {"rotations": np.eye(3)[None] * 2},
        {"rotations": np.full((1, 3, 3), np.nan)},
        {"rotations": np.full((1, 3, 3), 1e200)},
        {"rotations": np.eye(3)},
        {"rotations": "no array"},
        {"maps": np.full((1, 10), -2, np.int32)},
        {"maps": np.zeros((1, 10))},
        {"maps": None},
        {"maps": np.zeros((2, 10), np.int32)},
        {"energies": np.array([np.nan])},
        {"mismatches": np.array([np.inf])},
        {"mismatches": np.zeros(2)},
        {
            "energies": np.zeros(0),
            "mismatches": np.zeros(0),
            "rotations": np.zeros((0, 3, 3)),
            "maps": np.zeros((0, 3), np.int32),
        },
        {"lower_bound": "1"},
        {"status": "EXCELLENT"},
        {"status": ["FAILED"]},
    ],
)
def test_impossible_poses_are_refused(poses, change):
    record = to_record(poses)
    record |= {name: record[name][:1] for name in ("rotations", "maps", "energies", "mismatches")}
    from_record(PairPoses, record, "a ~ b")
    with pytest.raises(StoreError, match="a ~ b"):
        from_record(PairPoses, record | change, "a ~ b")


def test_numbers_that_are_not_known_come_back(poses):
    assert np.isnan(poses.mismatches).all()  # of so few samples neighbourhoods say nothing
    assert np.isnan(
        from_record(PairPoses, through_bytes(to_record(poses)), "a ~ b").mismatches
    ).all()
