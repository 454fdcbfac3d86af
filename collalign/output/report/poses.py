"""The poses of a shape that a person can choose among: those its pairs allow, then half turns."""

from __future__ import annotations

from typing import cast

import numpy as np

from collalign.output.collection_data import CollectionData
from collalign.products.pair import Alternative
from data_tools.arrays import FloatArray
from data_tools.poses import APART_DEG, keep_apart
from data_tools.rotations import rotation_angle_deg

#: Poses offered per shape.
MOST_POSES = 6


def offered_poses(collection: CollectionData) -> tuple[tuple[Alternative, ...], ...]:
    """For every shape its alternatives, completed by half turns about the principal axes of the collection's mean.

    Wrong poses are mostly half turns, and a shape whose pairs agree on a wrong pose has no alternative of its own.
    """
    half_turns = _half_turn_rotations(collection)
    offered = []
    for R, poses in zip(collection.rotations, collection.alternatives, strict=True):
        known = (*poses, *(Alternative(rotation=half_turn @ R, origin="half turn") for half_turn in half_turns))
        rotations = np.stack([R, *(one.rotation for one in known)])
        offered.append(tuple(known[at - 1] for at in keep_apart(rotations, APART_DEG, num=MOST_POSES + 1)[1:]))
    return tuple(offered)


def own_disagreements_deg(collection: CollectionData) -> FloatArray:
    """Return the angle between each shown pair's own likeliest pose, its first, and the collection's, shape (E,).

    Infinite where they disagree on handedness, NaN where the pair has no pose.
    """
    angles = np.full(len(collection.pairs), np.nan)
    for e, pair in enumerate(collection.pairs):
        if len(pair.rotations):
            common = collection.rotations[pair.target].T @ collection.rotations[pair.source]
            angles[e] = np.nan_to_num(rotation_angle_deg(pair.rotations[0], common), nan=np.inf)
    return angles


def _half_turn_rotations(collection: CollectionData) -> FloatArray:
    """Return rotations by 180 degrees about the principal axes of all aligned samples, shape (3, 3, 3)."""
    points = collection.aligned_landmarks.reshape(-1, 3)
    points = points[~np.isnan(points).any(axis=1)]
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2] if len(points) > 2 else np.eye(3)
    return cast(FloatArray, 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3))
