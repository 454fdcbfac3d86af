"""Other poses of a shape, and what dense points say of them against the reported one.

They are what its pairs offer, and what rotations lead to that leave the shape nearly as it is: such poses no pair can
tell from the reported one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collalign.stages.self_symmetry import SAME_AXIS, TWELFTHS
from collalign.whole_pairs.local_evidence import (
    all_points,
    local_evidence,
    surface_gap,
    surface_points,
)
from data_tools.arrays import BoolArray, FloatArray
from data_tools.embedding.copies import is_copy
from data_tools.embedding.embedding import Samples
from data_tools.poses import APART_DEG
from data_tools.rotations import rotation_angle_deg

#: Rivals that are tried, the most supported ones.
MAX_RIVALS = 7
#: Partners that a pose is tried against, the ones that match best.
MAX_PARTNERS = 8
#: Points of either surface whose neighbourhoods are compared at a pose: means over partners need few of each.
NUM_COMPARED = 100
#: Support of a candidate falls by this power of its energy over the pair's lowest.
SUPPORT_POWER = 4.0
#: No pose of a pair is less plausible than by these log-odds; one that it did not find is as plausible as its last.
LEAST_LOG_ODDS = -8.0
#: Squared distance, in squared radii, at which all points of a cloud lie exactly on those of another one: a surface
#: may look alike in several poses, but points that coincide are the same points.
EXACT = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Partner:
    """A shape that another one was matched with, and the poses that their pair offers.

    Attributes
    ----------
    shape : int
    poses : ndarray, shape (m, 3, 3)
        ``R_common_shape`` of the *other* shape that each candidate asks for, the most plausible first.
    excess : ndarray, shape (m,)
        How much less plausible each is than the first, 0 and more.
    log_odds : ndarray, shape (m,)
        The same as log-odds against the first, 0 and less.
    energy : float
        How badly the two match at best; 0 for copies.
    """

    shape: int
    poses: FloatArray
    excess: FloatArray
    log_odds: FloatArray
    energy: float


def rival_poses(pose: FloatArray, partners: Sequence[Partner], turns: FloatArray) -> FloatArray:
    """Return the poses that a shape could have instead, the most supported first.

    They are the candidates of its pairs, and the poses that turns lead to after which such shapes look alike.

    Parameters
    ----------
    pose : ndarray, shape (3, 3)
        The reported one.
    partners : sequence of Partner
    turns : ndarray, shape (t, 3, 3)
        Of the common frame.

    Returns
    -------
    ndarray, shape (r, 3, 3)
    """
    poses = np.concatenate([np.empty((0, 3, 3)), *(partner.poses for partner in partners)])
    excess = np.concatenate([np.empty(0), *(partner.excess for partner in partners)])
    apart = ~_near(poses, pose[None])[:, 0]
    found = _representatives(poses[apart], np.exp(-SUPPORT_POWER * excess[apart])).reshape(-1, 3, 3)
    alike = turns @ pose
    return np.concatenate(
        [found, alike[~_near(alike, np.concatenate([pose[None], found])).any(axis=1)]]
    )


def leads_over(pose: FloatArray, rivals: FloatArray, partners: Sequence[Partner]) -> FloatArray:
    """Return how much more plausible a shape's pairs find a pose than each rival, mean log-odds, shape (r,).

    A pose that a pair did not find is as plausible as its last; but where most partners are copies of the shape, at
    energy 0, a pose at which a copy does not fit exactly is as implausible as any.

    Parameters
    ----------
    pose : ndarray, shape (3, 3)
    rivals : ndarray, shape (r, 3, 3)
    partners : sequence of Partner
        Where there are none, no pose leads.
    """
    poses = np.concatenate([pose[None], rivals])
    odds = np.zeros(len(poses))
    mostly_copies = are_copies(partners)
    for partner in partners:
        own = np.maximum(partner.log_odds, LEAST_LOG_ODDS)
        not_found = LEAST_LOG_ODDS if mostly_copies and partner.energy == 0.0 else own.min()
        odds += np.where(_near(partner.poses, poses), own[:, None], not_found).max(axis=0)
    return np.asarray((odds[0] - odds[1:]) / max(len(partners), 1))


def are_copies(partners: Sequence[Partner]) -> bool:
    """Return whether most partners of a shape are copies of it."""
    return 2 * sum(partner.energy == 0.0 for partner in partners) > len(partners)


def _near(poses: FloatArray, others: FloatArray) -> BoolArray:
    """Return which poses are within :data:`APART_DEG` of each other; mirror images never are."""
    same: BoolArray = np.einsum("aij,bij->ab", poses, others) >= 1.0 + 2.0 * np.cos(
        np.deg2rad(APART_DEG)
    )
    return same


def _representatives(poses: FloatArray, support: FloatArray) -> FloatArray:
    """Return one pose of each cluster, greedily by the support around it; of ties the best supported one."""
    near, left = _near(poses, poses), np.ones(len(poses), dtype=bool)
    chosen: list[int] = []
    while left.any() and len(chosen) < MAX_RIVALS:
        total = np.where(left, near @ (support * left), -1.0)
        tied = np.isclose(total, total.max())
        best = int(np.argmax(np.where(tied, support, -1.0)))
        chosen.append(best)
        left &= ~near[best]
    return poses[chosen]


def pose_costs(
    shape: Samples, poses: FloatArray, partners: tuple[Samples, ...], partner_poses: FloatArray
) -> FloatArray:
    """Return what every pose of a shape costs against every partner; runs inside a worker.

    Parameters
    ----------
    shape : Samples
    poses : ndarray, shape (r, 3, 3)
        ``R_common_shape``.
    partners : tuple of Samples
    partner_poses : ndarray, shape (p, 3, 3)

    Returns
    -------
    ndarray, shape (2, r, p)
        Mean squared distance of closest points and normals, both ways, in squared radii; and the mismatch of the
        descriptors of neighbourhoods, NaN where either shape has none. Clouds that lie exactly on each other at one
        of the poses are compared by all of their points.
    """
    own = surface_points(shape, first=0)
    costs = np.empty((2, len(poses), len(partners)))
    for p, (partner, partner_pose) in enumerate(zip(partners, partner_poses, strict=True)):
        relative = partner_pose.T @ poses
        costs[0, :, p] = surface_gap(surface_points(partner, first=1), own, relative)
        if shape.rim == partner.rim == "unknown" and is_copy(shape.signature, partner.signature):
            whole = surface_gap(all_points(partner), all_points(shape), relative)
            if whole.min() < EXACT:
                costs[0, :, p] = whole
        costs[1, :, p] = local_evidence(partner, shape, relative, num_points=NUM_COMPARED)[0]
    return costs


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
