"""What contradicts a pose of two depth images: points where what saw the other surface would have seen them."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.local_surface import MOST_COMPARED, LocalSurface

#: Unit of shares of points in front of what was seen or beside it. At right poses they are mostly below it.
#: Larger shares of points beside what was seen than the second tell no more: a scanner may have missed a part.
FRONT_UNIT, MOST_BESIDE = 0.01, 0.05


def sight_conflicts(
    target: LocalSurface,
    source: LocalSurface,
    rotations: FloatArray,
    shifts: FloatArray,
    *,
    num_points: int = MOST_COMPARED,
) -> tuple[FloatArray, FloatArray]:
    """Return the shares of points in front of what was seen of the other surface, and beside it, each (p, 2).

    Those of the target come first, along the possible line of sight that they contradict least. NaN where no single
    direction saw all of the other surface.

    Parameters
    ----------
    target, source : LocalSurface
    rotations : ndarray, shape (p, 3, 3)
        Of determinant 1.
    shifts : ndarray, shape (p, 3)
        Source coordinates to those of the target, with the rotations.
    num_points : int
        Points of either surface that are looked at, at most.
    """
    to, of = (one.points[:: -(-len(one.points) // num_points)] for one in (target, source))
    shares = np.full((2, len(rotations), 2), np.nan)
    inverses = np.swapaxes(rotations, 1, 2)
    for side, seen, points in (
        (0, source, (to - shifts[:, None]) @ rotations),
        (1, target, of @ inverses + shifts[:, None]),
    ):
        if seen.depth_images:
            possible = np.stack([image.conflicts(points) for image in seen.depth_images])
            least = possible.sum(axis=2).argmin(axis=0)
            shares[:, :, side] = possible[least, np.arange(len(points))].T
    return shares[0], shares[1]


def conflict(in_front: FloatArray, beside: FloatArray) -> FloatArray:
    """Return how shares (p, 2) in front of what was seen and beside it contradict poses, at least 0, shape (p,)."""
    front = np.nan_to_num(in_front.max(axis=1, initial=0.0))
    return np.asarray(
        np.log1p(front / FRONT_UNIT)
        + np.log1p(
            np.minimum(np.nan_to_num(beside.max(axis=1, initial=0.0)), MOST_BESIDE) / FRONT_UNIT
        )
    )
