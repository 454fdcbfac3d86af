"""Poses in which a shape looks like itself: turns, and mirror images.

Every second dense point of a surface is compared with the others, so that no point finds itself. Of a table all
points are compared: at a turn of more than some degrees none is where it was.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy

from collalign.whole_pairs.local_evidence import (
    local_evidence,
    point_gaps,
    surface_gap,
    surface_points,
)
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.poses import APART_DEG, keep_apart
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg
from pairwise.rotation_sets import quaternions_to_rotations, super_fibonacci

#: Rotations onto itself that are looked at, at so many points; the best turns and mirror images that are refined, and
#: in how many steps.
NUM_ROTATIONS, NUM_SCREEN_POINTS, NUM_REFINED, NUM_MIRRORED, NUM_STEPS = 600, 100, 40, 12, 8
#: Turns that are kept, the best ones (the cube has 23); so many about one axis are taken for any angle about it.
MAX_TURNS, MANY_TURNS = 12, 5
TWELFTHS = np.arange(30.0, 360.0, 30.0)
#: Cosine of the angle within which axes are told as one.
SAME_AXIS = np.cos(np.deg2rad(10.0))
#: Points (n, 3) of a surface and their normals.
_Surface: TypeAlias = tuple[FloatArray, FloatArray]


def near_symmetries(samples: Samples) -> FloatArray:
    """Return the rotations that bring a shape's surface nearest to itself, the best first, shape (m, 3, 3).

    An axis about which many are found may be one of rotation: then all rotations about it by twelfths are returned
    instead.
    """
    rotations = quaternions_to_rotations(super_fibonacci(NUM_ROTATIONS))
    rotations = rotations[rotation_angle_deg(rotations) > APART_DEG]
    best, _ = _nearest_to_itself(samples, rotations, NUM_REFINED)
    ranked = np.concatenate([np.eye(3)[None], best])
    found = ranked[keep_apart(ranked, APART_DEG, num=MAX_TURNS + 1)][1:]
    axes = scipy.spatial.transform.Rotation.from_matrix(found).as_rotvec()
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    about = np.abs(axes @ axes.T) > SAME_AXIS
    most = about[int(np.argmax(about.sum(axis=1)))]
    if most.sum() < MANY_TURNS:
        return found
    axis = np.linalg.eigh(axes[most].T @ axes[most])[1][:, -1]
    return np.concatenate(
        [
            scipy.spatial.transform.Rotation.from_rotvec(
                np.outer(TWELFTHS, axis), degrees=True
            ).as_matrix(),
            found[~most],
        ]
    )


def mirrored_costs(samples: Samples) -> tuple[float, float]:
    """Return what a shape's own mirror image costs on it where it lies best; runs inside a worker.

    Returns
    -------
    gap : float
        As :func:`collalign.whole_pairs.local_evidence.surface_gap`.
    mismatch : float
        Of its neighbourhoods; NaN where they are not described.
    """
    flipped = quaternions_to_rotations(super_fibonacci(NUM_ROTATIONS)) * [-1.0, 1.0, 1.0]
    best, gaps = _nearest_to_itself(samples, flipped, NUM_MIRRORED)
    return float(gaps[0]), float(local_evidence(samples, samples, best[:1])[0][0])


def _nearest_to_itself(
    samples: Samples, rotations: FloatArray, num: int
) -> tuple[FloatArray, FloatArray]:
    """Return so many of the rotations (m, 3, 3) that bring a surface nearest to itself, refined, and their gaps."""
    fixed, moving = surface_points(samples, first=0), surface_points(samples, first=1)
    to, of = (
        (points[:NUM_SCREEN_POINTS], normals[:NUM_SCREEN_POINTS])
        for points, normals in (fixed, moving)
    )
    screened = np.argsort(surface_gap(to, of, rotations), kind="stable")[:num]
    refined = np.stack([_settled(fixed, moving, rotation) for rotation in rotations[screened]])
    gaps = surface_gap(fixed, moving, refined)
    order = np.argsort(gaps, kind="stable")
    return refined[order], gaps[order]


def _settled(fixed: _Surface, moving: _Surface, rotation: FloatArray) -> FloatArray:
    """Return the rotation after some steps of closest points, both ways, and Procrustes about the centroid."""
    determinant = float(np.sign(np.linalg.det(rotation)))
    for _ in range(NUM_STEPS):
        gaps = next(point_gaps(fixed, moving, rotation[None]))[0]
        there, back = gaps.argmin(axis=0), gaps.argmin(axis=1)
        cross = fixed[0][there].T @ moving[0] + fixed[0].T @ moving[0][back]
        rotation = nearest_orthogonal(cross, determinant=determinant)
    return rotation
