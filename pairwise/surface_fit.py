"""The pose of two surfaces from their dense samples, to be as accurate as the surfaces allow.

Closest points of two samplings are apart for two reasons. Along the surface, points lie where they were put. Across
it, specimens differ. So a gap has one variance along the normal and another one across it, as in generalised closest
points (Segal, Haehnel and Thrun 2009). Here both are estimated from the gaps, at every step. Surfaces that are alike
are held by their planes, and surfaces that differ by their outlines.

Two specimens differ everywhere, and least squares weigh all of it. Two versions of *one* surface agree exactly where
neither is bent or broken, and there is their pose. Weights that fall with the distance (Geman and McClure 1987) find
that part. The spacing of the points says whether it is one: then half of them lie as near as sampling alone leaves
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import nearest_orthogonal
from data_tools.threads import one_blas_thread
from pairwise.dense import DenseMatcher, DensePoints, centred_pose


class FitTuning(NamedTuple):
    """Numbers of the fit of two surfaces.

    Chosen on CAPOD's horses, spiders, guns and pianos, the first two also triangulated anew, SHREC07's chairs, planes
    and glasses, and molars; skulls decided when a pose is settled.
    """

    normal_weight: float = 0.2
    """Weight of unit normals relative to positions of root mean square radius 1, for nearest points."""
    settled: float = 1e-3
    """A pose is settled when no entry of R changes by more. 2e-3 takes a fifth less time, but skulls of mice (median
    error 1 degree) are .05 degrees worse; 2e-4 is no better."""
    shared_spacings: float = 0.6
    """Two surfaces share a part where half of the points have the other one's nearest point within so many spacings
    of its points. Two samplings of one surface are .46 to .55 apart. Hardly a pair below .6 is worse for it, many
    above .65 are."""
    least_gain: float = 2.0
    """That part fits better than all of both surfaces by this factor, in squares. Distances that are distributed
    normally in space give 1.8, and in the plane 2.4: then no part differs."""
    farthest_spacings: float = 1.5
    """No part is looked for where they are farther apart than this: few pairs of these collections have one, ..."""
    coarsest: float = 0.17
    """... nor where the spacing is more than this share of the radius, as of pianos of 55 vertices: poses that differ
    by 6 degrees then look alike."""
    least_ratio: float = 1e-4
    """Neither variance is less than this share of the other one: the equations keep full rank."""


#: The numbers in use.
FIT = FitTuning()


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceFit:
    """The pose of two surfaces.

    Attributes
    ----------
    pose : Similarity
        Takes the source to the target, of the same chirality as the start.
    energy : float
        Mean squared distance of the matched points at this pose, in squared units of the target.
    shared_energy : float
        The same as the points are weighed, where the pose is that of a part which both surfaces share; else the
        energy.
    """

    pose: Similarity
    energy: float
    shared_energy: float


@one_blas_thread()
def fit_surfaces(
    target: DensePoints,
    source: DensePoints,
    R_target_source: ArrayLike,
    *,
    estimate_scale: bool = True,
    find_shared: bool = True,
    max_iterations: int = 16,
) -> SurfaceFit:
    """Fit two surfaces on their dense samples, from centroids that are brought together.

    Parameters
    ----------
    target, source : DensePoints
        Without normals of both, gaps have one variance in all directions.
    R_target_source : array_like, shape (d, d)
        The pose to start from.
    estimate_scale : bool
        Estimate a scale factor of the source as well, from the ratio of the sizes; else 1.
    find_shared : bool
        Look for a part that both surfaces share; else fit them as wholes.
    max_iterations : int
        Of each of the two fits, the whole surfaces and the part that they share.

    Raises
    ------
    InputError
        If the start is not a pose, or the shapes' arrays do not fit each other.
    OptionsError
        If there is no iteration.

    Examples
    --------
    >>> points = pairwise.DensePoints.from_user(np.random.default_rng(0).random((200, 3)))
    >>> turned_by_16_deg = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
    >>> found = pairwise.fit_surfaces(points, points, turned_by_16_deg)
    >>> bool(np.allclose(found.pose.rotation, np.eye(3), atol=1e-3))
    True
    """
    if max_iterations < 1:
        raise OptionsError("max_iterations must be at least 1")
    start = centred_pose(target, source, R_target_source, estimate_scale=estimate_scale)
    matcher = DenseMatcher(target, source, normal_weight=FIT.normal_weight * target.radius)
    whole = _settled(matcher, start, max_iterations, robust=False, any_size=estimate_scale)
    energy = matcher.mean_cost(whole.pairs, whole.pose)
    found = SurfaceFit(pose=whole.pose, energy=energy, shared_energy=energy)
    if not find_shared:
        return found
    coarsest = max(one.spacing / one.radius for one in (target, source))
    if coarsest > FIT.coarsest or not _agrees(matcher, whole, FIT.farthest_spacings):
        return found
    part = _settled(matcher, whole.pose, max_iterations, robust=True, any_size=estimate_scale)
    if not _agrees(matcher, part, FIT.shared_spacings):
        return found
    return SurfaceFit(
        pose=part.pose,
        energy=matcher.mean_cost(part.pairs, part.pose),
        shared_energy=_robust_mean(part.distances),
    )


class _Settled(NamedTuple):
    """A settled pose, and the last pairs on target and source with their distances, (p,) each."""

    pose: Similarity
    pairs: tuple[IntArray, IntArray]
    distances: FloatArray


def _settled(
    matcher: DenseMatcher, pose: Similarity, most: int, *, robust: bool, any_size: bool
) -> _Settled:
    """Iterate closest points and steps of least squares from a pose, with equal or robust weights."""
    for _ in range(most):
        pairs = matcher.pair_up(pose)
        placed = pose.apply(matcher.source.points.take(pairs[1], axis=0))
        gaps = matcher.target.points.take(pairs[0], axis=0) - placed
        distances = np.sqrt(np.einsum("pk,pk->p", gaps, gaps))
        weights = _robust_weights(distances) if robust else np.ones(len(gaps))
        former = pose
        normals = _mean_normals(matcher, pairs, pose)
        pose = _stepped(pose, placed, gaps, normals, weights, any_size=any_size)
        if np.abs(pose.rotation - former.rotation).max() <= FIT.settled:
            break
    return _Settled(pose, pairs, distances)


def _robust_weights(distances: FloatArray) -> FloatArray:
    """Return the weights of Geman and McClure's ``d^2 / (d^2 + s^2)``, whose scale s is the median distance."""
    middle = max(float(np.median(distances)), np.finfo(float).tiny)
    return np.asarray((1.0 + (distances / middle) ** 2) ** -2)


def _robust_mean(distances: FloatArray) -> float:
    """Return the mean squared distance by robust weights."""
    return float(np.average(distances**2, weights=_robust_weights(distances)))


def _agrees(matcher: DenseMatcher, fit: _Settled, most: float) -> bool:
    """Whether half of the points are within so many spacings of the other surface, and the others farther than usual.

    Each distance is by the spacing of the points among which the nearest was looked for.
    """
    target, source = matcher.target, matcher.source
    numbers = len(source.points), len(target.points)
    spacings = np.repeat([target.spacing, fit.pose.scale * source.spacing], numbers)
    if np.median(fit.distances / spacings) > most:
        return False
    return float((fit.distances**2).mean()) > FIT.least_gain * _robust_mean(fit.distances)


def _mean_normals(
    matcher: DenseMatcher, pairs: tuple[IntArray, IntArray], pose: Similarity
) -> FloatArray:
    """Return the unit mean normals of pairs at a pose, shape (p, d); zeros where the shapes have none."""
    of_target, of_source = matcher.target.normals, matcher.source.normals
    if of_target is None or of_source is None:
        return np.zeros((len(pairs[0]), matcher.target.points.shape[1]))
    sums = of_target.take(pairs[0], axis=0) + (of_source @ pose.rotation.T).take(pairs[1], axis=0)
    lengths = np.sqrt(np.einsum("pk,pk->p", sums, sums))
    return np.asarray(sums / np.maximum(lengths, np.finfo(float).tiny)[:, None])


def _stepped(
    pose: Similarity,
    placed: FloatArray,
    gaps: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    *,
    any_size: bool,
) -> Similarity:
    """Return the pose after a Gauss-Newton step of ``sum_p w_p r_p^T (I + (ratio - 1) n_p n_p^T) r_p``.

    The ratio is that of the variances of gaps r along and across the surface. The scale is the ratio of the sizes if
    ``any_size``, else it stays.

    Parameters
    ----------
    pose : Similarity
    placed, gaps, normals : ndarray, shape (p, d)
        Points of the source at the pose, from there to those of the target, and unit normals or zeros.
    weights : ndarray, shape (p,)
    """
    dim = placed.shape[1]
    shares = weights / weights.sum()
    middle = shares @ placed
    arms = placed - middle
    across = np.einsum("pk,pk->p", gaps, normals)
    through = float(shares @ across**2)
    along = (float(shares @ np.einsum("pk,pk->p", gaps, gaps)) - through) / (dim - 1)
    least = max(FIT.least_ratio * max(through, along), np.finfo(float).tiny)
    ratio = max(along, least) / max(through, least)
    first, second, generators = _generators(dim)
    flat, num = generators.reshape(len(generators), -1), len(generators)
    moments, forces = np.zeros((num + dim, num + dim)), np.zeros(num + dim)
    if normals.any():
        slopes = np.empty((len(arms), num + dim))
        slopes[:, :num] = arms.take(first, axis=1) * normals.take(second, axis=1)
        slopes[:, :num] -= arms.take(second, axis=1) * normals.take(first, axis=1)
        slopes[:, num:] = normals
        pulled = slopes * ((ratio - 1.0) * shares)[:, None]
        moments, forces = pulled.T @ slopes, across @ pulled
    weighted = arms * shares[:, None]
    spread = weighted.T @ arms
    moments[:num, :num] += (generators @ spread).reshape(num, -1) @ flat.T
    forces[:num] += flat @ (gaps.T @ weighted).ravel()
    forces[num:] += shares @ gaps
    diagonal = np.einsum("kk->k", moments)
    diagonal[num:] += 1.0
    # What nothing holds, as a rotation of points on a line about it, stays.
    diagonal += np.finfo(float).eps * diagonal.sum()
    step = np.linalg.solve(moments, forces)
    turn = nearest_orthogonal(np.eye(dim) + (step[:num] @ flat).reshape(dim, dim))
    to = placed + gaps
    centred = to - shares @ to
    size, size_of = float(shares @ np.einsum("pk,pk->p", centred, centred)), float(np.trace(spread))
    grown = float(np.sqrt(size / size_of)) if any_size and min(size, size_of) > 0 else 1.0
    return Similarity(
        rotation=turn @ pose.rotation,
        scale=grown * pose.scale,
        shift=grown * turn @ (pose.shift - middle) + middle + step[num:],
    )


@cache
def _generators(dim: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return every two axes, and the derivative of a rotation in their plane, shape (d (d - 1) / 2, d, d)."""
    first, second = np.triu_indices(dim, 1)
    found = np.zeros((len(first), dim, dim))
    found[np.arange(len(first)), second, first] = 1.0
    found[np.arange(len(first)), first, second] = -1.0
    return read_only(first), read_only(second), read_only(found)
