from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from collalign.records import Record, decode, encode
from collalign.stored_types import match_from_record, match_to_record, samples_from_record, samples_to_record
from data_tools.embedding import Samples
from data_tools.errors import StoreError
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
        notes=("decimated",),
    )


def through_bytes(record: Record) -> Record:
    return decode(encode(record), "x")


def same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple) and a and hasattr(a[0], "energy"):
        return len(a) == len(b) and all(same_fields(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray):
        return bool(a.dtype == b.dtype and a.tobytes() == b.tobytes() and not b.flags.writeable)
    return bool(a == b or (a != a and b != b))


def same_fields(a: Any, b: Any, *, without: tuple[str, ...] = ()) -> bool:
    return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a) if f.name not in without)


@pytest.fixture
def result(rng: np.random.Generator) -> MatchResult:
    points = rng.standard_normal((10, 3))
    return match(points, points[rng.permutation(10)] @ np.diag([1.0, -1.0, -1.0]), seed=0)


@pytest.mark.parametrize("num_functions", [0, 4])
@pytest.mark.parametrize("num_invariants", [0, 3])
def test_samples_come_back(rng: np.random.Generator, num_functions: int, num_invariants: int) -> None:
    samples = make_samples(rng, num_functions=num_functions, num_invariants=num_invariants)
    back = samples_from_record(through_bytes(samples_to_record(samples)), "tooth")
    assert same_fields(samples, back)
    assert samples_from_record(samples_to_record(samples), "another").name == "another"
    assert not same_fields(samples, make_samples(rng), without=("name",))


def test_matches_come_back_without_timings(result: MatchResult) -> None:
    back = match_from_record(through_bytes(match_to_record(result)), "a ~ b", num_target=10)
    assert same_fields(result, back, without=("times_s",))
    assert back.times_s == {}


def test_a_failed_match_keeps_its_nan() -> None:
    nan = float("nan")
    failed = MatchResult(
        R_target_source=np.full((3, 3), nan),
        map_target_source=np.full(5, -1),
        energy=nan,
        lower_bound=nan,
        candidates=(),
        status=Status.FAILED,
    )
    back = match_from_record(through_bytes(match_to_record(failed)), "a ~ b")
    assert same_fields(failed, back)
    with pytest.raises(StoreError, match="a ~ b"):
        match_from_record(match_to_record(failed) | {"status": "CONVERGED"}, "a ~ b")


@pytest.mark.parametrize(
    "change",
    [
        {"R": np.eye(3) * 2},
        {"R": np.full((3, 3), np.nan)},
        {"R": "no array"},
        {"map": np.full(10, 10, np.int32)},
        {"map": np.full(10, -2, np.int32)},
        {"map": np.zeros(10)},
        {"map": None},
        {"energy": float("nan")},
        {"energy": "1"},
        {"status": "EXCELLENT"},
        {"status": ["FAILED"]},
        {"candidate_R": np.zeros((1, 3, 3))},
        {"candidate_R": np.eye(3)},
        {"candidate_energy": np.array([np.nan])},
        {"candidate_origin": ["search"] * 99},
        {"candidate_reflected": np.array([7])},
    ],
)
def test_impossible_matches_are_refused(result: MatchResult, change: dict[str, Any]) -> None:
    record = match_to_record(result)
    match_from_record(record, "a ~ b", num_target=10)
    with pytest.raises(StoreError, match="a ~ b"):
        match_from_record(record | change, "a ~ b", num_target=10)


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
        (match_to_record(result), match_from_record),
    ):
        for field in record:
            with pytest.raises(StoreError, match=f"'{field}' is missing"):
                read({name: value for name, value in record.items() if name != field}, "x")
