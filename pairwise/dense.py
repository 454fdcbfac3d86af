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
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray, IntArray, as_floats, as_points, as_rotations, read_only
from data_tools.errors import InputError, OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import nearest_orthogonal
from data_tools.threads import one_blas_thread
from pairwise.problem import Problem
from pairwise.results import Candidate, MatchResult, Status

#: Entries of the cost matrix that nearest neighbours hold at once.
_CHUNK_ENTRIES = 1_000_000


@dataclass(frozen=True, eq=False)
class DensePoints:
    """The dense samples of one shape, prepared once for many pairs; build it with :meth:`from_user`.

    Attributes
    ----------
    points : ndarray, shape (l, d)
    normals : ndarray, shape (l, d), or None
        Of unit length; None where the shape has no surface.
    invariants : ndarray, shape (l, m)
        Coordinates that no rotation changes, in units of the points; m may be 0.
    """

    points: FloatArray
    normals: FloatArray | None
    invariants: FloatArray

    @classmethod
    def from_user(
        cls,
        points: ArrayLike,
        normals: ArrayLike | None = None,
        invariants: ArrayLike | None = None,
    ) -> DensePoints:
        """Check points (n, d), their normals (n, d) and invariants (n, m).

        Raises
        ------
        InputError
            If they are not finite, of different shapes, or all points lie in one place.
        """
        checked = as_points(points, "points", min_points=2)
        if not np.ptp(checked, axis=0).any():
            raise InputError("points: all lie in one place")
        directions = (
            None
            if normals is None
            else read_only(as_floats(normals, "normals", shape=checked.shape))
        )
        scalars = np.empty((len(checked), 0)) if invariants is None else invariants
        return cls(
            read_only(checked),
            directions,
            read_only(as_floats(scalars, "invariants", shape=(len(checked), None))),
        )

    @cached_property
    def radius(self) -> float:
        """Root mean square distance from the centroid."""
        return float(np.sqrt(((self.points - self.points.mean(axis=0)) ** 2).sum(axis=1).mean()))

    @cached_property
    def spacing(self) -> float:
        """Root mean square distance of a point from the nearest one at another place."""
        places = np.unique(self.points, axis=0)
        nearest = cKDTree(places).query(places, k=2)[0][:, 1]
        return float(np.sqrt((nearest**2).mean()))


class DenseMatcher:
    """Matches the dense samples of two shapes at any pose.

    Parameters
    ----------
    target, source : DensePoints
    normal_weight : float
        Weight of the unit normals, in units of the target; 0 leaves them out.
    """

    def __init__(
        self, target: DensePoints, source: DensePoints, *, normal_weight: float = 0.0
    ) -> None:
        self.target, self.source = target, source
        has_normals = target.normals is not None and source.normals is not None
        self._normal_weight = normal_weight if has_normals else 0.0
        dim = target.points.shape[1]
        still = Similarity(rotation=np.eye(dim), scale=1.0, shift=np.zeros(dim))
        self._target, self._source = self._columns(target, still), self._columns(source, still)
        self._from_target = _squared_from(self._target)
        self._there, self._back = _Nearest(len(source.points)), _Nearest(len(target.points))

    def mean_cost(self, pairs: tuple[IntArray, IntArray], pose: Similarity) -> float:
        """Return the mean over pairs of squared distance of points and of invariants; normals are left out.

        Parameters
        ----------
        pairs : tuple of ndarray of int, shape (p,) each
            Indices on target and source.
        pose : Similarity
            Takes the source to the target.
        """
        of_target, of_source = pairs
        gaps = self.target.points[of_target] - pose.apply(self.source.points[of_source])
        other = self.target.invariants[of_target] - self.source.invariants[of_source]
        return float(((gaps**2).sum() + (other**2).sum()) / len(gaps))

    def _columns(self, shape: DensePoints, pose: Similarity) -> FloatArray:
        """Return columns (f, 1) of what is compared at a pose: places, invariants and weighted normals."""
        features = [
            (pose.scale * pose.rotation) @ shape.points.T + pose.shift[:, None],
            shape.invariants.T,
        ]
        if self._normal_weight and shape.normals is not None:
            features.append((self._normal_weight * pose.rotation) @ shape.normals.T)
        return np.concatenate([*features, np.ones((1, len(shape.points)))])

    def pair_up(self, pose: Similarity) -> tuple[IntArray, IntArray]:
        """Return indices on target and source, shape (p,) each, of nearest neighbours both ways at a pose."""
        former, self._source = self._source, self._columns(self.source, pose)
        moved = np.sqrt(np.square(self._source - former).sum(axis=0))
        from_source = _squared_from(self._source)
        self._there.look(self._source, from_source[-1], self._from_target, 2.0 * moved)
        self._back.look(
            self._target, self._from_target[-1], from_source, moved[self._back.rows] + moved.max()
        )
        own = [np.arange(len(one.rows)) for one in (self._there, self._back)]
        return np.concatenate([self._there.rows, own[1]]), np.concatenate([own[0], self._back.rows])


def _squared_from(columns: FloatArray) -> FloatArray:
    """Return (-2 f, |f|^2) of columns (f, 1): their products with (t, 1) are |t - f|^2 - |t|^2."""
    doubled = -2.0 * columns
    np.einsum("kl,kl->l", columns[:-1], columns[:-1], out=doubled[-1])
    return doubled


class _Nearest:
    """The nearest one of others to each of some features, while these move: looked for where it may have changed.

    It has not while its lead over the second nearest is more than what both have moved since (Hamerly 2010).
    """

    def __init__(self, num: int) -> None:
        self.rows, self._leads = np.zeros(num, dtype=np.int64), np.full(num, -np.inf)

    def look(
        self, own: FloatArray, sizes: FloatArray, others: FloatArray, moved: FloatArray
    ) -> None:
        """Find what is nearest, in slabs; no lead has shrunk by more than ``moved``, ``sizes`` are |own|^2."""
        self._leads -= moved
        unsure, slab = np.flatnonzero(self._leads <= 0.0), max(1, _CHUNK_ENTRIES // others.shape[1])
        rounding = (
            4.0 * np.finfo(float).eps * (len(own) + 1) * float(sizes.max() + others[-1].max())
        )
        for first in range(0, len(unsure), slab):
            rows = unsure[first : first + slab]
            costs, each = own.take(rows, axis=1).T @ others, np.arange(len(rows))
            self.rows[rows] = nearest = costs.argmin(axis=1)
            least = np.maximum(costs[each, nearest] + sizes[rows], 0.0)
            costs[each, nearest] = np.inf
            second = np.maximum(costs.min(axis=1) + sizes[rows] - rounding, 0.0)
            self._leads[rows] = np.sqrt(second) - np.sqrt(least + rounding)


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
    pose = centred_pose(target, source, R_target_source, estimate_scale=estimate_scale)
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


def centred_pose(
    target: DensePoints, source: DensePoints, R_target_source: ArrayLike, *, estimate_scale: bool
) -> Similarity:
    """Return the checked rotation with centroids, and sizes where the scale is free, brought together.

    Raises
    ------
    InputError
        If the rotation is none, or the shapes' arrays do not fit each other.
    """
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


#: For ranking candidates: normals pull bent limbs off the pose that most of a shape agrees on; more steps than these
#: let bent shapes drift.
_RANKING_NORMAL_WEIGHT, _RANKING_ITERATIONS = 0.0, 8


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
        normal_weight=_RANKING_NORMAL_WEIGHT,
        max_iterations=_RANKING_ITERATIONS,
    )
