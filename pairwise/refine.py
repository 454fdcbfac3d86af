"""Refinement of a pose on dense samples: two-way nearest neighbours or exact assignment, and similarity Procrustes.

A match of few samples is accurate to their spacing only. From its pose, iterative closest points (Besl and McKay
1992) on some hundreds of points per shape settles the rotation, a shift and a scale; normals, where there are any,
tell the two sides of a ridge apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from data_tools.arrays import FloatArray, IntArray, as_floats, as_points, as_rotations, read_only
from data_tools.errors import InputError, OptionsError
from pairwise.status import Status

Correspondence = Literal["nearest", "assignment"]

#: Weight of unit normals beside positions of root mean square radius 1.
NORMAL_WEIGHT = 0.2


@dataclass(frozen=True, eq=False)
class DensePoints:
    """The dense samples of one shape, prepared once for many pairs; build it with :meth:`from_user`.

    Attributes
    ----------
    points : ndarray, shape (l, d)
    normals : ndarray, shape (l, d), or None
        Of unit length; None where the shape has no surface.
    """

    points: FloatArray
    normals: FloatArray | None

    @classmethod
    def from_user(cls, points: ArrayLike, normals: ArrayLike | None = None) -> DensePoints:
        """Check the arrays.

        Raises
        ------
        InputError
            If they are not finite, of different shapes, or all points lie in one place.
        """
        checked = as_points(points, "points", min_points=2)
        if not np.ptp(checked, axis=0).any():
            raise InputError("points: all lie in one place")
        directions = None if normals is None else read_only(as_floats(normals, "normals", shape=checked.shape))
        return cls(read_only(checked), directions)

    @cached_property
    def radius(self) -> float:
        """Root mean square distance from the centroid."""
        return float(np.sqrt(((self.points - self.points.mean(axis=0)) ** 2).sum(axis=1).mean()))

    def features(self, linear: FloatArray, shift: FloatArray, turn: FloatArray, weight: float) -> FloatArray:
        """Return moved points, with turned and weighted normals where ``weight`` is positive, shape (l, d or 2 d)."""
        moved = self.points @ linear.T + shift
        if weight <= 0 or self.normals is None:
            return moved
        return np.hstack([moved, weight * (self.normals @ turn.T)])


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedPose:
    """A pose refined on dense samples: target ~ scale * R source + translation.

    Attributes
    ----------
    R_target_source : ndarray, shape (d, d)
        Of the same chirality as the start.
    scale : float
    translation : ndarray, shape (d,)
    energy : float
        Mean squared distance of the matched points at this pose, in squared units of the target.
    initial_energy : float
        The same for the first correspondences at the start.
    iterations : int
    status : Status
    """

    R_target_source: FloatArray
    scale: float
    translation: FloatArray
    energy: float
    initial_energy: float
    iterations: int
    status: Status


def refine_pose(
    target: DensePoints,
    source: DensePoints,
    R_target_source: ArrayLike,
    *,
    correspondence: Correspondence = "nearest",
    estimate_scale: bool = True,
    normal_weight: float = NORMAL_WEIGHT,
    max_iterations: int = 30,
    tol: float = 1e-4,
) -> RefinedPose:
    """Refine a pose on dense samples.

    Parameters
    ----------
    target, source : DensePoints
        ``assignment`` needs at least as many target as source points.
    R_target_source : array_like, shape (d, d)
        The pose to start from; centroids are brought together first.
    correspondence : {"nearest", "assignment"}
        Each point with the nearest of the other shape, both ways, or a one-to-one assignment of least cost.
    estimate_scale : bool
        Estimate a scale factor of the source as well.
    normal_weight : float
        Weight of the normals beside positions of unit root mean square radius; 0 leaves them out.
    max_iterations : int
    tol : float
        Stops when no entry of R changes by more.

    Returns
    -------
    RefinedPose

    Raises
    ------
    InputError
        If the start is not orthogonal, or there are more source than target points for an assignment.
    OptionsError
        If an option is impossible.
    """
    rotation = as_rotations(R_target_source, "R_target_source", dim=target.points.shape[1])
    if correspondence not in get_args(Correspondence):
        raise OptionsError(f"correspondence: expected one of {get_args(Correspondence)}, got {correspondence!r}")
    if correspondence == "assignment" and len(source.points) > len(target.points):
        raise InputError(f"source has {len(source.points)} points, target {len(target.points)}: swap the two")
    if normal_weight < 0 or max_iterations < 1:
        raise OptionsError("normal_weight must not be negative, max_iterations at least 1")
    pair_up = _nearest if correspondence == "nearest" else _assigned
    weight = normal_weight * target.radius if source.normals is not None and target.normals is not None else 0.0
    chirality = np.sign(np.linalg.det(rotation))
    scale = target.radius / source.radius if estimate_scale else 1.0
    shift = target.points.mean(axis=0) - scale * rotation @ source.points.mean(axis=0)
    initial_energy, status, iterations = float("nan"), Status.ITERATION_LIMIT, 0
    for iterations in range(1, max_iterations + 1):
        of_target, of_source = pair_up(target, source, rotation, scale, shift, weight)
        to, of = target.points[of_target], source.points[of_source]
        if iterations == 1:
            initial_energy = _mean_square(to, of, rotation, scale, shift)
        former = rotation
        rotation, scale, shift = _procrustes(to, of, chirality, scale if not estimate_scale else None)
        if np.abs(rotation - former).max() <= tol:
            status = Status.CONVERGED
            break
    return RefinedPose(
        R_target_source=read_only(rotation),
        scale=scale,
        translation=read_only(shift),
        energy=_mean_square(to, of, rotation, scale, shift),
        initial_energy=initial_energy,
        iterations=iterations,
        status=status,
    )


def _nearest(
    target: DensePoints, source: DensePoints, rotation: FloatArray, scale: float, shift: FloatArray, weight: float
) -> tuple[IntArray, IntArray]:
    """Return matched target and source points: nearest neighbours both ways."""
    moved = source.features(scale * rotation, shift, rotation, weight)
    fixed = target.features(np.eye(len(shift)), np.zeros(len(shift)), np.eye(len(shift)), weight)
    of_target = cKDTree(fixed).query(moved)[1]
    of_source = cKDTree(moved).query(fixed)[1]
    return (
        np.concatenate([of_target, np.arange(len(fixed))]),
        np.concatenate([np.arange(len(moved)), of_source]),
    )


def _assigned(
    target: DensePoints, source: DensePoints, rotation: FloatArray, scale: float, shift: FloatArray, weight: float
) -> tuple[IntArray, IntArray]:
    """Return matched target and source points: the one-to-one assignment of least cost."""
    moved = source.features(scale * rotation, shift, rotation, weight)
    fixed = target.features(np.eye(len(shift)), np.zeros(len(shift)), np.eye(len(shift)), weight)
    of_source, of_target = linear_sum_assignment(cdist(moved, fixed, "sqeuclidean"))
    return of_target, of_source


def _procrustes(
    to: FloatArray, of: FloatArray, chirality: float, scale: float | None
) -> tuple[FloatArray, float, FloatArray]:
    """Return rotation, scale and shift that bring ``of`` to ``to`` best (Umeyama 1991) at a given chirality.

    The scale is the symmetric one, the ratio of the sizes, so that refining either way gives inverse results.
    """
    mean_to, mean_of = to.mean(axis=0), of.mean(axis=0)
    u, _, vt = np.linalg.svd((to - mean_to).T @ (of - mean_of))
    signs = np.ones(len(u))
    signs[-1] = np.sign(np.linalg.det(u @ vt)) * chirality
    rotation = (u * signs) @ vt
    if scale is None:
        scale = float(np.sqrt(((to - mean_to) ** 2).sum() / ((of - mean_of) ** 2).sum()))
    return rotation, scale, mean_to - scale * rotation @ mean_of


def _mean_square(to: FloatArray, of: FloatArray, rotation: FloatArray, scale: float, shift: FloatArray) -> float:
    return float(((scale * of @ rotation.T + shift - to) ** 2).sum(axis=1).mean())
