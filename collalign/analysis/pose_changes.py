"""How much of one alignment another alignment of the same shapes keeps: poses and mirror images."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.poses import AGREE_DEG
from data_tools.rotations import rotation_angle_deg


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
