"""Turns that leave a shape nearly as it is: other poses that no pair can tell from the reported one."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from collalign.stages.local_evidence import point_gaps, surface_gap, surface_points
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.poses import APART_DEG, keep_apart
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg
from pairwise.rotation_sets import quaternions_to_rotations, super_fibonacci

#: Turns that are looked at, at so many points, and the best of them that are refined, in so many steps.
NUM_ROTATIONS, NUM_SCREEN_POINTS, NUM_REFINED, NUM_STEPS = 600, 100, 40, 8
#: Turns that are kept, the best ones (the cube has 23); so many about one axis are taken for any angle about it.
MAX_TURNS, MANY_TURNS = 12, 5
TWELFTHS = np.arange(30.0, 360.0, 30.0)
#: Cosine of the angle within which axes are told as one.
SAME_AXIS = np.cos(np.deg2rad(10.0))

_Surface = tuple[FloatArray, FloatArray]


def near_symmetries(samples: Samples) -> FloatArray:
    """Return the rotations that bring a shape's surface nearest to itself, the best first, shape (m, 3, 3).

    Every second dense point is compared with the others, so that no point finds itself. An axis about which many are
    found may be one of rotation: then all rotations about it by twelfths are returned instead.
    """
    fixed, moving = surface_points(samples, first=0), surface_points(samples, first=1)
    rotations = quaternions_to_rotations(super_fibonacci(NUM_ROTATIONS))
    rotations = rotations[rotation_angle_deg(rotations) > APART_DEG]
    few = tuple(
        (points[:NUM_SCREEN_POINTS], normals[:NUM_SCREEN_POINTS])
        for points, normals in (fixed, moving)
    )
    gaps = surface_gap(few[0], few[1], rotations)
    best = [
        _refined(fixed, moving, rotation)
        for rotation in rotations[np.argsort(gaps, kind="stable")[:NUM_REFINED]]
    ]
    exact = surface_gap(fixed, moving, np.stack(best))
    ranked = np.stack([np.eye(3), *(best[n] for n in np.argsort(exact, kind="stable"))])
    found = ranked[keep_apart(ranked, APART_DEG, num=MAX_TURNS + 1)][1:]
    axes = Rotation.from_matrix(found).as_rotvec()
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    about = np.abs(axes @ axes.T) > SAME_AXIS
    most = about[int(np.argmax(about.sum(axis=1)))]
    if most.sum() < MANY_TURNS:
        return found
    axis = np.linalg.eigh(axes[most].T @ axes[most])[1][:, -1]
    return np.concatenate(
        [Rotation.from_rotvec(np.outer(TWELFTHS, axis), degrees=True).as_matrix(), found[~most]]
    )


def _refined(fixed: _Surface, moving: _Surface, rotation: FloatArray) -> FloatArray:
    """Return the rotation after some steps of closest points, both ways, and Procrustes."""
    for _ in range(NUM_STEPS):
        gaps = next(point_gaps(fixed, moving, rotation[None]))
        there, back = gaps.argmin(axis=0), gaps.argmin(axis=1)
        cross = fixed[0][there].T @ moving[0] + fixed[0].T @ moving[0][back]
        rotation = nearest_orthogonal(cross, determinant=1.0)
    return rotation


def describe_rotations(rotations: FloatArray) -> str:
    """Return what rotations (m, 3, 3) are: their axes as directions, angles about each, and whether some reflect."""
    by_axis: list[tuple[FloatArray, list[float]]] = []
    mirrored = np.linalg.det(rotations) < 0
    for rotation in rotations[~mirrored]:
        axis = _axis(rotation)
        angle = float(rotation_angle_deg(rotation))
        known = next((angles for other, angles in by_axis if abs(other @ axis) > SAME_AXIS), None)
        if known is None:
            by_axis.append((axis, [angle]))
        else:
            known.append(angle)
    parts = []
    for axis, angles in by_axis[:3]:
        degrees = ", ".join(f"{angle:.0f}" for angle in sorted({round(angle) for angle in angles}))
        amount = "any angle" if len(angles) == len(TWELFTHS) else f"{degrees} deg"
        parts.append(f"{amount} about ({', '.join(f'{x:.2f}' for x in axis)})")
    more = f" and rotations about {len(by_axis) - 3} more axes" if len(by_axis) > 3 else ""
    return "; ".join([*parts, *(["mirror images"] if mirrored.any() else [])]) + more


def _axis(rotation: FloatArray) -> FloatArray:
    """Return the axis of a rotation, its largest coordinate positive."""
    values, vectors = np.linalg.eigh(rotation + rotation.T)
    axis = vectors[:, int(np.argmax(values))]
    axis = axis * np.sign(axis[int(np.argmax(np.abs(axis)))])
    return np.asarray(np.round(axis, 2) + 0.0)
