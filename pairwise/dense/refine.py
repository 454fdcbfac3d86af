"""Poses refined on dense samples by closest points both ways, and candidates ranked by both energies.

A match of few samples is accurate to their spacing only. From its pose, iterative closest points (Besl and McKay
1992) on some hundreds of points per shape settles the rotation, a shift and a scale. Normals, where there are any,
tell the two sides of a ridge apart; invariants keep the parts of a bent shape together.

The samples' energy knows that a match is one-to-one but sees few points; the dense points' energy (closest points
both ways, invariants included) sees the whole shape but lets points share a counterpart. Each is a sum of squares
whose noise level is unknown and differs from shape to shape, so each says by its *logarithm* how likely a pose is
(the profile likelihood of the noise level), and the two together by the sum of the logarithms: the candidates are
ranked by the product of both energies. On rigid shapes (teeth) and on bent ones (ants, teddy bears) the product picks
the right pose more often than the samples' energy alone; the dense energy alone loses on bent shapes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, as_rotations
from data_tools.errors import InputError, OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import nearest_orthogonal
from data_tools.threads import one_blas_thread
from pairwise.dense.points import DenseMatcher, DensePoints
from pairwise.problem.problem import Problem
from pairwise.results import Candidate, MatchResult
from pairwise.status import Status

#: Weight of unit normals relative to positions of root mean square radius 1.
NORMAL_WEIGHT = 0.2
#: A pose is settled when no entry of R changes by more.
_SETTLED = 1e-4


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
    """

    pose: Similarity
    energy: float


@one_blas_thread()
def refine_pose(
    target: DensePoints,
    source: DensePoints,
    R_target_source: ArrayLike,
    *,
    estimate_scale: bool = True,
    normal_weight: float = NORMAL_WEIGHT,
    max_iterations: int = 30,
) -> RefinedPose:
    """Refine a pose on dense samples, from centroids that are brought together.

    Parameters
    ----------
    target, source : DensePoints
    R_target_source : array_like, shape (d, d)
        The pose to start from.
    estimate_scale : bool
        Estimate a scale factor of the source as well, from the ratio of the sizes; else 1.
    normal_weight : float
        Weight of the normals relative to positions of unit root mean square radius; 0 leaves them out.
    max_iterations : int

    Returns
    -------
    RefinedPose

    Raises
    ------
    InputError
        If the start is not a pose, or the shapes' arrays do not fit each other.
    OptionsError
        If an option is impossible.

    Examples
    --------
    >>> points = pairwise.DensePoints.from_user(np.random.default_rng(0).random((200, 3)))
    >>> turned_by_16_deg = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
    >>> found = pairwise.refine_pose(points, points, turned_by_16_deg)
    >>> bool(np.allclose(found.pose.rotation, np.eye(3), atol=1e-3))
    True
    """
    if not normal_weight >= 0 or max_iterations < 1:
        raise OptionsError("normal_weight must not be negative, max_iterations at least 1")
    pose = _start(target, source, R_target_source, estimate_scale=estimate_scale)
    matcher = DenseMatcher(target, source, normal_weight=normal_weight * target.radius)
    chirality = float(np.sign(np.linalg.det(pose.rotation)))
    pairs = matcher.pair_up(pose)
    for iterations in range(1, max_iterations + 1):
        former = pose
        to, of = target.points.take(pairs[0], axis=0), source.points.take(pairs[1], axis=0)
        pose = _procrustes(to, of, chirality, None if estimate_scale else pose.scale)
        if np.abs(pose.rotation - former.rotation).max() <= _SETTLED:
            break
        if iterations < max_iterations:
            pairs = matcher.pair_up(pose)
    return RefinedPose(pose=pose, energy=matcher.mean_cost(pairs, pose))


def _start(
    target: DensePoints, source: DensePoints, R_target_source: ArrayLike, *, estimate_scale: bool
) -> Similarity:
    dim = target.points.shape[1]
    if source.points.shape[1] != dim or source.invariants.shape[1] != target.invariants.shape[1]:
        raise InputError(
            f"source: expected {dim} coordinates and {target.invariants.shape[1]} invariants as the target has, got "
            f"{source.points.shape[1]} and {source.invariants.shape[1]}"
        )
    rotation = as_rotations(R_target_source, "R_target_source", dim=dim)
    scale = target.radius / source.radius if estimate_scale else 1.0
    shift = target.points.mean(axis=0) - scale * rotation @ source.points.mean(axis=0)
    return Similarity(rotation=rotation, scale=scale, shift=shift)


def _procrustes(
    to: FloatArray, of: FloatArray, chirality: float, scale: float | None
) -> Similarity:
    """Return the similarity that brings ``of`` to ``to`` best (Umeyama 1991) at a given chirality.

    The scale is the symmetric one, the ratio of the sizes, so that refining either way gives inverse results.
    """
    mean_to, mean_of = (np.full(len(to), 1.0 / len(to)) @ points for points in (to, of))
    centred_to, centred_of = to - mean_to, of - mean_of
    rotation = nearest_orthogonal(centred_to.T @ centred_of, determinant=chirality)
    if scale is None:
        sizes = [float((points**2).sum()) for points in (centred_to, centred_of)]
        scale = float(np.sqrt(sizes[0] / sizes[1])) if min(sizes) > 0 else 1.0
    return Similarity(rotation=rotation, scale=scale, shift=mean_to - scale * rotation @ mean_of)


#: Normals pull bent limbs off the pose that most of a shape agrees on; more steps than these let bent shapes drift.
_NORMAL_WEIGHT, _MAX_ITERATIONS = 0.0, 8


def ranked_on_dense(
    result: MatchResult, problem: Problem, dense: tuple[DensePoints, DensePoints]
) -> tuple[MatchResult, tuple[RefinedPose, ...]]:
    """Return a match whose candidates are ranked by the product of both energies, and their refined poses.

    Parameters
    ----------
    result : MatchResult
        Bound, certificate and energies stay about the samples; proven is the answer only where it is of the same
        energy as before.
    problem : Problem
    dense : pair of DensePoints
        Of target and source, in the coordinates of the rotation block and the units of the samples.
    """
    poses = [_refined_on_dense(candidate, problem, dense) for candidate in result.candidates]
    # Exact matches of the samples differ on the dense points at most.
    both = zip(result.candidates, poses, strict=True)
    pairs = sorted(both, key=lambda pair: (pair[0].energy * pair[1].energy, pair[1].energy))
    best = pairs[0][0]
    is_other = best.energy > result.energy
    ranked = replace(
        result,
        R_target_source=best.R_target_source,
        map_target_source=best.map_target_source,
        energy=best.energy,
        candidates=tuple(candidate for candidate, _ in pairs),
        status=Status.LOCAL_OPTIMUM
        if is_other and result.status is Status.PROVEN_OPTIMAL
        else result.status,
    )
    return ranked, tuple(pose for _, pose in pairs)


def _refined_on_dense(
    candidate: Candidate, problem: Problem, dense: tuple[DensePoints, DensePoints]
) -> RefinedPose:
    block = problem.pattern.rotation_block
    return refine_pose(
        *dense,
        candidate.R_target_source[:block, :block],
        estimate_scale=False,
        normal_weight=_NORMAL_WEIGHT,
        max_iterations=_MAX_ITERATIONS,
    )
