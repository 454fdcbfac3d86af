"""How much of one alignment another alignment of the same shapes keeps: poses, mirror images, neighbours."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.poses import AGREE_DEG
from data_tools.rotations import rotation_angle_deg

#: Nearest neighbours that are compared, of at least so many others twice over.
NUM_NEIGHBOURS = 3


def pose_changes(reference: FloatArray, again: FloatArray, part_numbers: IntArray) -> tuple[FloatArray, BoolArray]:
    """Return by how much each pose differs, and whether it is mirrored as before, in the frame that most agree with.

    The common frame of an alignment is arbitrary. So the second one is turned as the shape asks with which most
    others are within :data:`AGREE_DEG`, of several such frames as that with the smallest sum of angles.

    Parameters
    ----------
    reference, again : ndarray, shape (n, 3, 3)
        ``R_common_shape`` of the same shapes.
    part_numbers : ndarray of int, shape (n,)
        Shapes of different part_numbers are not aligned with each other in the reference.

    Returns
    -------
    changes_deg : ndarray, shape (n,)
        NaN where mirrored differently, and for a shape alone in its group, which has nothing to stand still to.
    same_chirality : ndarray of bool, shape (n,)
    """
    changes_deg, same = np.full(len(part_numbers), np.nan), np.ones(len(part_numbers), dtype=bool)
    for number in np.unique(part_numbers):
        members = np.flatnonzero(part_numbers == number)
        if len(members) < 2:
            continue
        before, after = reference[members], again[members]
        frames = before @ np.swapaxes(after, 1, 2)
        angles = rotation_angle_deg(frames[:, None] @ after[None], before)
        worst = np.nan_to_num(angles, nan=180.0)
        best = np.lexsort((worst.sum(axis=1), -(worst <= AGREE_DEG).sum(axis=1)))[0]
        changes_deg[members], same[members] = angles[best], ~np.isnan(angles[best])
    return changes_deg, same


def kept_neighbours(reference: FloatArray, again: FloatArray) -> FloatArray:
    """Return the share of each shape's nearest neighbours that are its nearest neighbours again, shape (n,).

    Parameters
    ----------
    reference, again : ndarray, shape (n, n)
        Distances of the same shapes; NaN where there is none.

    Notes
    -----
    :data:`NUM_NEIGHBOURS`, of few shapes half of the others: among two others both are always near.
    """
    num = max(1, min(NUM_NEIGHBOURS, (len(reference) - 1) // 2))
    before, after = (_nearest(distances, num) for distances in (reference, again))
    counts = before.sum(axis=1)
    return np.where(counts > 0, (before & after).sum(axis=1) / np.maximum(counts, 1), np.nan)


def _nearest(distances: FloatArray, num: int) -> BoolArray:
    """Return which shapes (columns) are among the nearest of each (row)."""
    away = np.where(np.isnan(distances) | np.eye(len(distances), dtype=bool), np.inf, distances)
    near = np.zeros(away.shape, dtype=bool)
    np.put_along_axis(near, np.argsort(away, axis=1, kind="stable")[:, :num], True, axis=1)
    return near & np.isfinite(away)
