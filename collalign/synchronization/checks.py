"""What synchronization accepts, and angles, moves and checks of orthogonal matrices; frames are ``R_i_common``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import BoolArray, FloatArray, IntArray, as_indices
from data_tools.errors import InputError, OptionsError
from data_tools.rotations import chordal_angles
from pairwise.problem.pattern import RotationPattern


def angles_rad(rotations: FloatArray) -> FloatArray:
    """Return ``|log R|_F / sqrt 2`` of (..., d, d) matrices: the rotation angle for d = 2 and 3.

    A reflection counts pi for each eigenvalue -1 that has no partner, divided by sqrt 2.
    """
    if rotations.shape[-1] == 3:
        proper = chordal_angles(rotations, np.eye(3))
        if not rotations.size or np.linalg.det(rotations).min() > 0:
            return proper
    phases = (
        np.angle(np.linalg.eigvals(rotations)) if rotations.size else np.zeros(rotations.shape[:-1])
    )
    return np.sqrt((phases**2).sum(axis=-1) / 2.0)


def relative(frames: FloatArray, edges: IntArray) -> FloatArray:
    """Return ``R_i_j = frame_i frame_j^T`` of each edge, shape (E, d, d)."""
    return frames[edges[:, 0]] @ np.swapaxes(frames[edges[:, 1]], 1, 2)


def transposed(matrices: FloatArray) -> FloatArray:
    """Return a contiguous copy of (..., d, d) matrices transposed."""
    return np.ascontiguousarray(np.swapaxes(matrices, -1, -2))


def cayley(skew: FloatArray) -> FloatArray:
    """Return the rotations ``(I - A/2)^-1 (I + A/2)`` of skew matrices (..., d, d): exp(A) to second order."""
    unit = np.eye(skew.shape[-1])
    return np.asarray(np.linalg.solve(unit - skew / 2.0, unit + skew / 2.0), dtype=np.float64)


#: Entries outside the pattern that count as zero.
PATTERN_TOL = 1e-6


def checked_edges(edges: ArrayLike, num_shapes: int | None) -> IntArray:
    """Check pairs of shapes and return them as (E, 2) integers.

    Raises
    ------
    InputError
        If an index is out of range, a pair joins a shape to itself, or appears twice.
    OptionsError
        If there are fewer shapes than one.
    """
    if num_shapes is not None and num_shapes < 1:
        raise OptionsError(f"num_shapes: expected 1 or more, got {num_shapes}")
    upper = num_shapes if num_shapes is not None else np.iinfo(np.int64).max
    raw = np.asarray(edges)
    pairs = as_indices(
        raw.reshape(0, 2) if raw.size == 0 else raw, "edges", upper=upper, shape=(None, 2)
    )
    loops = np.flatnonzero(pairs[:, 0] == pairs[:, 1])
    if len(loops):
        raise InputError(f"edges: row {loops[0]} joins shape {pairs[loops[0], 0]} to itself")
    unordered, count = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
    if (count > 1).any():
        twice = unordered[np.argmax(count > 1)].tolist()
        raise InputError(
            f"edges: the pair {twice} appears more than once; give its rotations as candidates"
        )
    return pairs


def checked_energies(
    energies: ArrayLike | None, shape: tuple[int, int]
) -> tuple[FloatArray | None, BoolArray]:
    """Check energies of candidates; return them as (E, m), and which candidates there are, for ``shape`` (E, m).

    Raises
    ------
    InputError
        If one is negative or NaN, their number is another, or a pair has no candidate.
    """
    if energies is None:
        return None, np.ones(shape, dtype=bool)
    costs = np.array(energies, dtype=np.float64)
    if costs.shape == shape[:1] and shape[1] == 1:
        costs = costs[:, None]
    if costs.shape != shape:
        raise InputError(f"energies: expected shape {shape}, got {costs.shape}")
    if np.isnan(costs).any() or (costs < 0).any():
        raise InputError(
            "energies: expected numbers >= 0 (inf for a candidate that is not there), got NaN or less"
        )
    present = np.isfinite(costs)
    empty = np.flatnonzero(~present.any(axis=1))
    if len(empty):
        raise InputError(
            f"energies: pair {empty[0]} has no candidate of finite energy; leave the pair out"
        )
    return costs, present


def check_pattern(rotations: FloatArray, name: str, pattern: RotationPattern) -> None:
    """Check that matrices (..., d, d) fit a pattern.

    Raises
    ------
    InputError
        If an entry outside the pattern is not zero, or a block that must be a rotation is a reflection.
    """
    outside = float(np.abs(rotations[..., ~pattern.mask]).max(initial=0.0))
    if outside > PATTERN_TOL:
        raise InputError(f"{name}: entries outside rotation_pattern reach {outside:.2g}")
    for start, stop in pattern.special_blocks:
        if rotations.size and np.linalg.det(rotations[..., start:stop, start:stop]).min() < 0:
            raise InputError(f"{name}: contains a reflection (determinant -1) but group is 'SO'")
