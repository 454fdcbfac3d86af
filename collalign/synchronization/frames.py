"""Frames, one orthogonal matrix per shape: what is computed with them, and the gauge that pairs leave open.

Inside synchronization frames are ``R_i_common``; what leaves it is ``R_common_i``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from data_tools.arrays import FloatArray, IntArray, as_points, as_rotations
from data_tools.errors import InputError
from data_tools.rotations import chordal_angles
from data_tools.threads import one_blas_thread
from pairwise.rotation_pattern import RotationPattern


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


#: Principal axes whose variances differ by less than this part, or whose skewness is below it, have no stable sign.
AXIS_TOL = 1e-9


def fix_gauge(
    rotations: FloatArray,
    parts: Sequence[IntArray],
    *,
    reference: int = 0,
    fixed: Mapping[int, FloatArray] | None = None,
    pattern: RotationPattern,
) -> FloatArray:
    """Return ``R_common_i`` in which, in each group, the first member's pose (or the reference's) is the identity.

    Parameters
    ----------
    rotations : ndarray, shape (N, d, d)
        ``R_common_i``.
    parts : sequence of ndarray of int
        Parts that have a gauge each.
    reference : int
        Shape whose pose is the identity in its group.
    fixed : mapping of int to ndarray (d, d), optional
        Shapes whose ``R_common_i`` is given: a group that has such shapes takes its gauge from them, and they get
        exactly what was given.
    pattern : RotationPattern

    Returns
    -------
    ndarray, shape (N, d, d)
    """
    given = fixed or {}
    gauged = rotations.copy()
    for members in parts:
        inside = [int(i) for i in members if int(i) in given]
        if inside:
            moves = pattern.project(sum(given[i] @ rotations[i].T for i in inside))
        else:
            moves = rotations[reference if reference in members else members[0]].T
        gauged[members] = moves @ rotations[members]
        for i in inside:
            gauged[i] = given[i]
    return gauged


@one_blas_thread()
def principal_axes_gauge(samples: Sequence[FloatArray], rotations: FloatArray) -> FloatArray:
    """Return ``R_common_i`` in the gauge of the principal axes of all posed samples together.

    The first axis has the largest variance. Each axis points to where the cloud's third moment is positive; the last
    one is rotated where the axes would make a reflection. Only the first three coordinates are rotated.

    Parameters
    ----------
    samples : sequence of ndarray, shape (k_i, d)
    rotations : ndarray, shape (N, d, d)
        ``R_common_i``.

    Raises
    ------
    InputError
        If there is not one rotation per shape.
    """
    frames = as_rotations(rotations, "rotations")
    if len(samples) != len(frames):
        raise InputError(f"samples: {len(samples)} shapes, but {len(frames)} rotations")
    space = min(3, frames.shape[-1])
    cloud = np.concatenate(
        [
            as_points(x, f"samples[{i}]") @ g[:space].T
            for i, (x, g) in enumerate(zip(samples, frames, strict=True))
        ]
    )
    cloud -= cloud.mean(axis=0)
    _, vectors = np.linalg.eigh(cloud.T @ cloud)
    axes = vectors[:, ::-1].T
    moments = ((cloud @ axes.T) ** 3).mean(axis=0) / np.maximum(
        (cloud**2).sum(axis=1).mean() ** 1.5, AXIS_TOL
    )
    largest = axes[np.arange(space), np.argmax(np.abs(axes), axis=1)]
    axes = axes * np.where(np.abs(moments) > AXIS_TOL, np.sign(moments), np.sign(largest))[:, None]
    if np.linalg.det(axes) < 0:
        axes[-1] *= -1.0
    rotation = np.eye(frames.shape[-1])
    rotation[:space, :space] = axes
    return rotation @ frames
