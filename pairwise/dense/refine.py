"""Refinement of a pose on dense samples: two-way nearest neighbours or exact assignment, and similarity Procrustes.

A match of few samples is accurate to their spacing only. From its pose, iterative closest points (Besl and McKay
1992) on some hundreds of points per shape settles the rotation, a shift and a scale. Normals, where there are any,
tell the two sides of a ridge apart; invariants keep the parts of a bent shape together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, as_floats, as_rotations
from data_tools.checks import check_choice
from data_tools.errors import InputError, OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import nearest_orthogonal
from data_tools.threads import one_blas_thread
from pairwise.dense.point_to_plane import point_to_plane
from pairwise.dense.points import DenseMatcher, DensePoints
from pairwise.options import RefinementMethod
from pairwise.status import Status

#: Weight of unit normals beside positions of root mean square radius 1.
NORMAL_WEIGHT = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedPose:
    """A pose refined on dense samples.

    Attributes
    ----------
    pose : Similarity
        Takes the source to the target, of the same chirality as the start.
    energy : float
        Mean squared distance of the matched points at this pose plus that of their invariants, in squared units of
        the target.
    initial_energy : float
        The same for the first correspondences at the start.
    iterations : int
        0 for point-to-plane, whose library does not say.
    status : Status
    """

    pose: Similarity
    energy: float
    initial_energy: float
    iterations: int
    status: Status


@one_blas_thread()
def refine_pose(
    target: DensePoints,
    source: DensePoints,
    R_target_source: ArrayLike,
    *,
    scale: float | None = None,
    translation: ArrayLike | None = None,
    method: RefinementMethod = "nearest",
    estimate_scale: bool = True,
    normal_weight: float = NORMAL_WEIGHT,
    unmatched_penalty: float = np.inf,
    matched_share: float = 1.0,
    max_iterations: int = 30,
    tol: float = 1e-4,
) -> RefinedPose:
    """Refine a pose on dense samples.

    Parameters
    ----------
    target, source : DensePoints
    R_target_source : array_like, shape (d, d)
        The pose to start from.
    scale : float, optional
        Factor of the source to start with; by default the ratio of the sizes where it is estimated, else 1.
    translation : array_like, shape (d,), optional
        Shift to start with; by default the one that brings the centroids together.
    method : {"nearest", "assignment", "point-to-plane"}
        Each point with the nearest of the other shape, both ways; or a one-to-one assignment of least cost, of as
        many points as the smaller shape has; or Open3D's point-to-plane ICP, which needs normals of the target, keeps
        the scale, and looks at neither invariants nor the source's normals (its energies are those of "nearest").
    estimate_scale : bool
        Estimate a scale factor of the source as well.
    normal_weight : float
        Weight of the normals beside positions of unit root mean square radius; 0 leaves them out.
    unmatched_penalty : float
        Partial shapes: pairs that cost more, in squared units of the target, are left out at this cost.
    matched_share : float
        Partial shapes: only this share of the pairs, those that cost least, takes part (Chetverikov et al. 2002).
    max_iterations : int
    tol : float
        Stops when no entry of R changes by more.

    Returns
    -------
    RefinedPose

    Raises
    ------
    InputError
        If the start is not a pose, or the shapes' arrays do not fit each other.
    OptionsError
        If an option is impossible, or Open3D is missing where it is needed.

    Examples
    --------
    >>> points = pairwise.DensePoints.from_user(np.random.default_rng(0).random((200, 3)))
    >>> turned_by_16_deg = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
    >>> found = pairwise.refine_pose(points, points, turned_by_16_deg)
    >>> bool(np.allclose(found.pose.rotation, np.eye(3), atol=1e-3))
    True
    """
    _check_options(method, normal_weight, unmatched_penalty, matched_share, max_iterations)
    start = _start(target, source, R_target_source, scale, translation, estimate_scale=estimate_scale)
    matcher = DenseMatcher(
        target,
        source,
        normal_weight=normal_weight * target.radius,
        one_to_one=method == "assignment",
        unmatched_penalty=unmatched_penalty,
        matched_share=matched_share,
    )
    if method == "point-to-plane":
        return _by_planes(matcher, start, max_iterations, tol)
    return _by_points(matcher, start, max_iterations, tol, estimate_scale=estimate_scale)


def _by_points(
    matcher: DenseMatcher, start: Similarity, max_iterations: int, tol: float, *, estimate_scale: bool
) -> RefinedPose:
    """Alternate correspondences and similarity Procrustes."""
    pose, chirality = start, float(np.sign(np.linalg.det(start.rotation)))
    pairs = matcher.pair_up(start)
    initial_energy = matcher.mean_cost(pairs, start)
    status, iterations = Status.ITERATION_LIMIT, 0
    for iterations in range(1, max_iterations + 1):
        if len(pairs.of_target) < start.rotation.shape[0]:
            status = Status.STALLED  # too few pairs below the penalty to determine a pose
            break
        former = pose
        to, of = matcher.target.points[pairs.of_target], matcher.source.points[pairs.of_source]
        pose = _procrustes(to, of, chirality, None if estimate_scale else pose.scale)
        if np.abs(pose.rotation - former.rotation).max() <= tol:
            status = Status.CONVERGED
            break
        if iterations < max_iterations:
            pairs = matcher.pair_up(pose)
    return RefinedPose(
        pose=pose,
        energy=matcher.mean_cost(pairs, pose),
        initial_energy=initial_energy,
        iterations=iterations,
        status=status,
    )


def _by_planes(matcher: DenseMatcher, start: Similarity, max_iterations: int, tol: float) -> RefinedPose:
    """Leave the work to Open3D; measure energies as for nearest neighbours."""
    pose, found = point_to_plane(
        matcher.target,
        matcher.source,
        start,
        max_distance=float(np.sqrt(matcher.penalty)),
        max_iterations=max_iterations,
        tol=tol,
    )
    before, after = (matcher.mean_cost(matcher.pair_up(p), p) for p in (start, pose))
    return RefinedPose(
        pose=pose,
        energy=after,
        initial_energy=before,
        iterations=0,
        status=Status.CONVERGED if found else Status.STALLED,
    )


def _start(
    target: DensePoints,
    source: DensePoints,
    R_target_source: ArrayLike,
    scale: float | None,
    translation: ArrayLike | None,
    *,
    estimate_scale: bool,
) -> Similarity:
    dim = target.points.shape[1]
    if source.points.shape[1] != dim or source.invariants.shape[1] != target.invariants.shape[1]:
        raise InputError(
            f"source: expected {dim} coordinates and {target.invariants.shape[1]} invariants as the target has, got "
            f"{source.points.shape[1]} and {source.invariants.shape[1]}"
        )
    rotation = as_rotations(R_target_source, "R_target_source", dim=dim)
    if scale is None:
        scale = target.radius / source.radius if estimate_scale else 1.0
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"scale: expected a positive number, got {scale}")
    if translation is None:
        shift = target.points.mean(axis=0) - scale * rotation @ source.points.mean(axis=0)
    else:
        shift = as_floats(translation, "translation", shape=(dim,))
    return Similarity(rotation=rotation, scale=float(scale), shift=shift)


def _check_options(
    method: str, normal_weight: float, unmatched_penalty: float, matched_share: float, max_iterations: int
) -> None:
    check_choice("method", method, get_args(RefinementMethod))
    if not normal_weight >= 0 or max_iterations < 1:
        raise OptionsError("normal_weight must not be negative, max_iterations at least 1")
    if not unmatched_penalty >= 0:
        raise OptionsError(f"unmatched_penalty: expected a number >= 0, got {unmatched_penalty}")
    if not 0 < matched_share <= 1:
        raise OptionsError(f"matched_share: expected more than 0, at most 1, got {matched_share}")


def _procrustes(to: FloatArray, of: FloatArray, chirality: float, scale: float | None) -> Similarity:
    """Return the similarity that brings ``of`` to ``to`` best (Umeyama 1991) at a given chirality.

    The scale is the symmetric one, the ratio of the sizes, so that refining either way gives inverse results.
    """
    mean_to, mean_of = to.mean(axis=0), of.mean(axis=0)
    centred_to, centred_of = to - mean_to, of - mean_of
    rotation = nearest_orthogonal(centred_to.T @ centred_of, determinant=chirality)
    if scale is None:
        sizes = [float((points**2).sum()) for points in (centred_to, centred_of)]
        scale = float(np.sqrt(sizes[0] / sizes[1])) if min(sizes) > 0 else 1.0
    return Similarity(rotation=rotation, scale=scale, shift=mean_to - scale * rotation @ mean_of)
