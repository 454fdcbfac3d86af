"""Angles, moves and noise-free checks on stacks of orthogonal matrices; frames are ``R_i_common``."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.rotations import chordal_angles


def angles_rad(rotations: FloatArray) -> FloatArray:
    """Return ``|log R|_F / sqrt 2`` of (..., d, d) matrices: the rotation angle for d = 2 and 3.

    A reflection counts pi for each eigenvalue -1 that has no partner, divided by sqrt 2.
    """
    if rotations.shape[-1] == 3:
        proper = chordal_angles(rotations, np.eye(3))
        if not rotations.size or np.linalg.det(rotations).min() > 0:
            return proper
    phases = np.angle(np.linalg.eigvals(rotations)) if rotations.size else np.zeros(rotations.shape[:-1])
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
