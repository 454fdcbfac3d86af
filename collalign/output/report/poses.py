"""The poses of a shape that a person can choose among: those its pairs allow, then half turns."""

from __future__ import annotations

from typing import cast

import numpy as np

from collalign.products.evidence import CollectionView
from collalign.products.pair import Alternative
from data_tools.arrays import FloatArray

#: Poses closer than this are not offered twice.
DISTINCT_DEG = 30.0
#: Poses offered per shape.
MOST_POSES = 6


def offered_poses(view: CollectionView) -> tuple[tuple[Alternative, ...], ...]:
    """For every shape its alternatives, completed by half turns about the principal axes of the collection's mean.

    Wrong poses are mostly half turns, and a shape whose pairs agree on a wrong pose has no alternative of its own.
    """
    turns = _half_turns(view)
    offered = []
    for R, poses in zip(view.rotations, view.alternatives, strict=True):
        kept: list[Alternative] = []
        half = [Alternative(rotation=turn @ R, origin="half turn") for turn in turns]
        for pose in (*poses, *half):
            if all(angle_deg(pose.rotation, other) > DISTINCT_DEG for other in (R, *(one.rotation for one in kept))):
                kept.append(pose)
        offered.append(tuple(kept[:MOST_POSES]))
    return tuple(offered)


def own_disagreements_deg(view: CollectionView) -> FloatArray:
    """Return the angle between each pair's own best pose, chosen or not, and the collection's, shape (E,).

    Infinite where they disagree on handedness, NaN where the pair has no pose.
    """
    return np.array(
        [
            angle_deg(pair.rotations[0], view.rotations[pair.target].T @ view.rotations[pair.source])
            if len(pair.rotations)
            else np.nan
            for pair in view.pairs
        ]
    )


def angle_deg(A: FloatArray, B: FloatArray) -> float:
    """Rotation angle between two orthogonal matrices in degrees; infinite if one mirrors and the other does not."""
    relative = A.T @ B
    if np.linalg.det(relative) < 0:
        return float("inf")
    return float(np.degrees(np.arccos(np.clip((np.trace(relative) - 1) / 2, -1.0, 1.0))))


def _half_turns(view: CollectionView) -> FloatArray:
    """Rotations by 180 degrees about the principal axes of all aligned samples, shape (3, 3, 3)."""
    points = view.aligned_samples.reshape(-1, 3)
    points = points[~np.isnan(points).any(axis=1)]
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2] if len(points) > 2 else np.eye(3)
    return cast(FloatArray, 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3))
