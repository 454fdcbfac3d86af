from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from collalign.engine.store.records import Record, decode, encode
from collalign.stages.stored_types import pair_from_record, poses_to_record, samples_from_record, samples_to_record
from data_tools.embedding.embedding import Samples
from data_tools.errors import SolveFailed, StoreError
from pairwise import match
from pairwise.results import MatchResult
from pairwise.status import Status


def make_samples(
    rng: np.random.Generator, *, num: int = 12, num_functions: int = 0, num_invariants: int = 2
) -> Samples:
    positions = rng.standard_normal((num, 3))
    positions -= positions.mean(axis=0)
    functions = rng.standard_normal((num, num_functions))
    return Samples(
        name="tooth",
        vertex_indices=rng.permutation(500)[:num],
        positions=positions,
        coordinates=np.hstack([positions, functions]),
        block_sizes=(3, num_functions) if num_functions else (3,),
        invariants=rng.standard_normal((num, num_invariants)),
        offset=rng.standard_normal(3),
        scale=2.5,
        dense_indices=np.arange(7),
        dense_positions=rng.standard_normal((7, 3)),
        dense_normals=rng.standard_normal((7, 3)),
        dense_invariants=rng.standard_normal((7, num_invariants)),
        notes=("decimated",),
    )


def through_bytes(record: Record) -> Record:
    return decode(encode(record), "x")


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return bool(a.dtype == b.dtype and a.tobytes() == b.tobytes() and not b.flags.writeable)
    return bool(a == b or (a != a and b != b))


def same_fields(a: Any, b: Any, *, without: tuple[str, ...] = ()) -> bool:
    return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a) if f.name not in without)


@pytest.fixture
def result(rng: np.random.Generator) -> MatchResult:
    return match(rng.standard_normal((10, 3)), rng.standard_normal((10, 3)), seed=0)


@pytest.mark.parametrize("num_functions", [0, 4])
@pytest.mark.parametrize("num_invariants", [0, 3])
def test_samples_come_back(rng: np.random.Generator, num_functions: int, num_invariants: int) -> None:
    samples = make_samples(rng, num_functions=num_functions, num_invariants=num_invariants)
    back = samples_from_record(through_bytes(samples_to_record(samples)), "tooth")
    assert same_fields(samples, back)
    assert samples_from_record(samples_to_record(samples), "another").name == "another"
    assert not same_fields(samples, make_samples(rng), without=("name",))


def test_poses_come_back(result: MatchResult) -> None:
    back = pair_from_record(through_bytes(poses_to_record(result)), "a ~ b")
    assert len(result.candidates) == len(back.energies) > 1
    for i, pose in enumerate(result.candidates):
        assert (pose.R_target_source == back.rotations[i]).all()
        assert (pose.map_target_source == back.maps[i]).all()
        assert pose.energy == back.energies[i]
    assert back.maps.dtype == np.int64
    assert not back.rotations.flags.writeable
    assert back.status == result.status.name
    assert np.isnan(back.lower_bound)


def test_a_match_without_a_pose_is_a_failure_and_no_record(result: MatchResult) -> None:
    with pytest.raises(SolveFailed, match="No usable answer"):
        poses_to_record(replace(result, candidates=(), status=Status.FAILED))


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
        {"energies": np.zeros(0), "rotations": np.zeros((0, 3, 3)), "maps": np.zeros((0, 3), np.int32)},
        {"lower_bound": "1"},
        {"status": "EXCELLENT"},
        {"status": ["FAILED"]},
    ],
)
def test_impossible_poses_are_refused(result: MatchResult, change: dict[str, Any]) -> None:
    record = poses_to_record(result)
    record |= {name: record[name][:1] for name in ("rotations", "maps", "energies")}
    pair_from_record(record, "a ~ b")
    with pytest.raises(StoreError, match="a ~ b"):
        pair_from_record(record | change, "a ~ b")


@pytest.mark.parametrize(
    "change",
    [
        {"positions": np.zeros((3, 2))},
        {"positions": np.full((12, 3), np.inf)},
        {"coordinates": np.zeros((12, 4))},
        {"block_sizes": [2]},
        {"block_sizes": [3, -1]},
        {"block_sizes": 3},
        {"vertex_indices": np.full(12, -1)},
        {"vertex_indices": np.arange(11)},
        {"scale": 0.0},
        {"scale": float("nan")},
        {"scale": True},
        {"offset": np.zeros(2)},
        {"dense_indices": np.arange(8)},
        {"notes": [1]},
    ],
)
def test_impossible_samples_are_refused(rng: np.random.Generator, change: dict[str, Any]) -> None:
    record = samples_to_record(make_samples(rng))
    samples_from_record(record, "tooth")
    with pytest.raises(StoreError, match="tooth"):
        samples_from_record(record | change, "tooth")


def test_missing_fields_are_named(rng: np.random.Generator, result: MatchResult) -> None:
    for record, read in (
        (samples_to_record(make_samples(rng)), samples_from_record),
        (poses_to_record(result), pair_from_record),
    ):
        for field in record:
            with pytest.raises(StoreError, match=f"'{field}' is missing"):
                read({name: value for name, value in record.items() if name != field}, "x")
