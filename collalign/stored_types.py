"""Preprocessed shapes and matches as records of the store, and back with every value checked.

What a record says is used only after its shapes, index ranges, finiteness and orthogonality have been checked, so
that a store made by somebody else can be wrong but not harmful. Names and timings are not part of a record: a shape's
record depends on the file's content alone, and a repeated run gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from collalign.records import Record
from data_tools.arrays import (
    FloatArray,
    IntArray,
    as_floats,
    as_indices,
    as_mask,
    as_points,
    as_rotations,
    read_only,
)
from data_tools.embedding import Samples
from data_tools.errors import InputError, StoreError
from pairwise.results import Candidate, MatchResult
from pairwise.status import Status

_MAX_INDEX = 2**31


def samples_to_record(samples: Samples) -> Record:
    """Return a preprocessed shape as a record, without its name."""
    return {
        "vertex_indices": samples.vertex_indices,
        "positions": samples.positions,
        "coordinates": samples.coordinates,
        "block_sizes": list(samples.block_sizes),
        "invariants": samples.invariants,
        "offset": samples.offset,
        "scale": float(samples.scale),
        "dense_indices": samples.dense_indices,
        "dense_positions": samples.dense_positions,
        "notes": list(samples.notes),
    }


def samples_from_record(record: Record, name: str) -> Samples:
    """Check a record and return the preprocessed shape.

    Parameters
    ----------
    record : dict
        From :func:`samples_to_record`, or anything else.
    name : str
        The shape's name in the present collection; also names it in the message.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with _as_store_error(name):
        positions = as_points(record["positions"], "positions", dim=3)
        k = len(positions)
        block_sizes = tuple(_positive(size, "block_sizes") for size in _listed(record["block_sizes"], "block_sizes"))
        if block_sizes[:1] != (3,) or len(block_sizes) > 2:
            raise InputError(f"block_sizes: expected (3,) or (3, m), got {block_sizes}")
        dense_indices = _indices(record["dense_indices"], "dense_indices")
        scale = _number(record["scale"], "scale")
        if not 0 < scale < np.inf:
            raise InputError(f"scale: expected a positive number, got {scale}")
        return Samples(
            name=name,
            vertex_indices=_indices(record["vertex_indices"], "vertex_indices", num=k),
            positions=read_only(positions),
            coordinates=_floats(record["coordinates"], "coordinates", (k, sum(block_sizes))),
            block_sizes=block_sizes,
            invariants=_floats(record["invariants"], "invariants", (k, None)),
            offset=_floats(record["offset"], "offset", (3,)),
            scale=scale,
            dense_indices=dense_indices,
            dense_positions=_floats(record["dense_positions"], "dense_positions", (len(dense_indices), 3)),
            notes=tuple(_text(note, "notes") for note in _listed(record["notes"], "notes")),
        )


def match_to_record(result: MatchResult) -> Record:
    """Return a match as a record, without its timings; candidates are stacked along the first axis."""
    poses = result.candidates
    dim = result.R_target_source.shape[-1]
    num_points = len(result.map_target_source)
    rotations = [pose.R_target_source for pose in poses]
    maps = [pose.map_target_source for pose in poses]
    return {
        "R": result.R_target_source,
        "map": result.map_target_source.astype(np.int32),
        "energy": float(result.energy),
        "lower_bound": float(result.lower_bound),
        "status": result.status.name,
        "candidate_R": np.array(rotations, dtype=np.float64).reshape(len(poses), dim, dim),
        "candidate_map": np.array(maps, dtype=np.int32).reshape(len(poses), num_points),
        "candidate_energy": np.array([pose.energy for pose in poses], dtype=np.float64),
        "candidate_scale": np.array([pose.scale for pose in poses], dtype=np.float64),
        "candidate_reflected": np.array([pose.reflected for pose in poses], dtype=np.bool_),
        "candidate_origin": [pose.origin for pose in poses],
    }


def match_from_record(record: Record, name: str, *, num_target: int = _MAX_INDEX) -> MatchResult:
    """Check a record and return the match; its ``times_s`` is empty.

    Parameters
    ----------
    record : dict
        From :func:`match_to_record`, or anything else.
    name : str
        Names the pair in the message.
    num_target : int
        Number of target points, which indices have to stay below.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible; NaN is accepted where the status is FAILED only.
    """
    with _as_store_error(name):
        status = _status(record["status"])
        num_points = len(np.atleast_1d(record["map"]))
        R = np.array(record["R"], dtype=np.float64)
        if status is not Status.FAILED or np.isfinite(R).all():
            R = as_rotations(R, "R")
        candidates = _candidates(record, R.shape, num_points, num_target)
        return MatchResult(
            R_target_source=read_only(R),
            map_target_source=_point_map(record["map"], "map", (num_points,), num_target),
            energy=_number(record["energy"], "energy", allow_nan=status is Status.FAILED),
            lower_bound=_number(record["lower_bound"], "lower_bound", allow_nan=True),
            candidates=candidates,
            status=status,
        )


def _candidates(
    record: Record, rotation_shape: tuple[int, ...], num_points: int, num_target: int
) -> tuple[Candidate, ...]:
    energies = as_floats(record["candidate_energy"], "candidate_energy", shape=(None,))
    num = len(energies)
    scales = as_floats(record["candidate_scale"], "candidate_scale", shape=(num,))
    reflected = as_mask(record["candidate_reflected"], "candidate_reflected", shape=(num,))
    rotations = as_floats(record["candidate_R"], "candidate_R", shape=(num, *rotation_shape))
    maps = _point_map(record["candidate_map"], "candidate_map", (num, num_points), num_target)
    origins = _listed(record["candidate_origin"], "candidate_origin")
    if len(origins) != num:
        raise InputError(f"candidate_origin: {len(origins)} of {num}")
    if num:
        rotations = as_rotations(rotations, "candidate_R")
    return tuple(
        Candidate(
            R_target_source=read_only(rotations[i].copy()),
            map_target_source=read_only(maps[i].copy()),
            energy=float(energies[i]),
            reflected=bool(reflected[i]),
            origin=_text(origins[i], "candidate_origin"),
            scale=float(scales[i]),
        )
        for i in range(num)
    )


@contextmanager
def _as_store_error(name: str) -> Iterator[None]:
    """Report whatever is wrong with a record as damage of the store."""
    try:
        yield
    except KeyError as error:
        raise StoreError(f"stored record of {name}: {error} is missing") from None
    except (InputError, TypeError, ValueError) as error:
        raise StoreError(f"stored record of {name}: {error}") from None


def _floats(value: Any, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    return read_only(as_floats(value, name, shape=shape))


def _indices(value: Any, name: str, num: int | None = None) -> IntArray:
    return read_only(as_indices(value, name, upper=_MAX_INDEX, shape=(num,)))


def _point_map(value: Any, name: str, shape: tuple[int, ...], num_target: int) -> IntArray:
    return read_only(as_indices(value, name, lower=-1, upper=num_target, shape=shape))


def _number(value: Any, name: str, *, allow_nan: bool = False) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name}: expected a number, got {type(value).__name__}")
    if not allow_nan and value != value:
        raise InputError(f"{name}: is NaN")
    return float(value)


def _positive(value: Any, name: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value < _MAX_INDEX:
        raise InputError(f"{name}: expected a positive integer, got {value!r}")
    return value


def _listed(value: Any, name: str) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{name}: expected a list, got {type(value).__name__}")
    return value


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"{name}: expected text, got {type(value).__name__}")
    return value


def _status(value: Any) -> Status:
    if not isinstance(value, str) or value not in Status.__members__:
        raise InputError(f"status: {value!r} is none")
    return Status[value]
