"""Search over the rotation block: an even set of rotations screened cheaply, the principal axes, a second look.

The rotation block of an embedding is its first block; for given rotation of it the other blocks follow in closed form
from the map that the rotation block alone finds best.

**Screening** of many poses is in single precision: which are worth exact assignment.
Exact assignment costs about k^3, nearest neighbours k n: the sum of the nearest distances is a lower bound of the
assignment's cost that ranks poses well, and nearest-neighbour ICP takes poses most of the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import CACHED_ENTRIES, BoolArray, FloatArray, IntArray, read_only
from data_tools.threads import one_blas_thread
from pairwise.local_search import LocalMinima, MatchingCosts, merge, minimise, procrustes
from pairwise.problem import Problem
from pairwise.rotation_pattern import RotationPattern
from pairwise.rotation_sets import (
    principal_frame,
    rotation_set,
    sign_rotations,
    small_rotations,
)

Singles: TypeAlias = NDArray[np.float32]

#: Poses whose costs are made at once, at least.
_LEAST_CHUNK = 48


class NearestCosts:
    """Nearest neighbours under the matching costs, for batches of poses; the pose is the last index of costs.

    Where k = n both directions count, because every target point is matched as well.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.both_ways = problem.num_source == problem.num_target
        unit = _size(problem)
        weights = problem.weights / problem.weights.max()
        self._unit_cost = unit**2 * problem.weights.max()
        target, source = problem.target / unit, problem.source / unit
        squares = (target**2).sum(axis=1)[:, None] + (source**2).sum(axis=1)
        fixed = weights * squares + problem.constant_cost / self._unit_cost
        self._fixed = np.where(problem.allowed, fixed, np.inf).astype(np.float32)[:, :, None]
        self._target = target.astype(np.float32)
        self._source_t = np.ascontiguousarray(
            (-2.0 * weights[:, None] * source).T, dtype=np.float32
        )
        self.chunk = max(_LEAST_CHUNK, CACHED_ENTRIES // fixed.size)

    def lower_bounds(self, rotations: FloatArray) -> FloatArray:
        """Return lower bounds of the least energy of rotations (m, d, d), shape (m,).

        It is the sum of the cheapest allowed costs of the source points, or the mean of this and of that of the
        target points where both count.
        """
        return np.concatenate([self._bounds(costs) for costs in self._costs(rotations)])

    def step(self, rotations: FloatArray) -> FloatArray:
        """Return the rotations (m, d, d) after a step of ICP, of the chirality that they have.

        Both directions count as in :meth:`lower_bounds`.
        """
        problem = self.problem
        mirrored = problem.pattern.mirrored(rotations)
        if not self.both_ways:
            nearest = [costs.argmin(axis=0).T for costs in self._costs(rotations)]
            return procrustes(problem, np.ascontiguousarray(np.concatenate(nearest)), mirrored)
        found = [
            (costs.argmin(axis=0).T, costs.argmin(axis=1).T) for costs in self._costs(rotations)
        ]
        maps, backs = (np.concatenate(columns) for columns in zip(*found, strict=True))
        weighted = problem.weights[:, None] * problem.source
        moments = (
            np.swapaxes(problem.target[maps], 1, 2) @ weighted + problem.target.T @ weighted[backs]
        )
        return problem.pattern.project(moments, mirrored)

    def _costs(self, rotations: FloatArray) -> Iterator[Singles]:
        """Yield the costs (n, k, m) of as many poses at a time as fit the cache."""
        for first in range(0, len(rotations), self.chunk):
            chunk = rotations[first : first + self.chunk].astype(np.float32)
            m, d = chunk.shape[:2]
            moved = (chunk.reshape(m * d, d) @ self._source_t).reshape(m, d, -1)
            moved = np.ascontiguousarray(moved.transpose(1, 2, 0))
            costs = (self._target @ moved.reshape(d, -1)).reshape(len(self._target), -1, m)
            costs += self._fixed
            yield costs

    def _bounds(self, costs: Singles) -> FloatArray:
        values = self._unit_cost * costs.min(axis=0).astype(np.float64)
        bounds = values.sum(axis=0)
        if not self.both_ways:
            return bounds
        while (half := (costs.shape[1] + 1) // 2) < costs.shape[
            1
        ]:  # faster than minima of many short rows
            costs = np.minimum(costs[:, :half], costs[:, -half:])
        return 0.5 * (bounds + self._unit_cost * costs[:, 0].astype(np.float64).sum(axis=0))


def _size(problem: Problem) -> float:
    """Return a length that brings the points into the range of single precision; 1 if all are at the origin."""
    return float(max(np.abs(problem.target).max(), np.abs(problem.source).max())) or 1.0


def screen(
    problem: Problem, rotations: FloatArray, *, num_steps: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Return rotations, improved by nearest-neighbour ICP (Besl and McKay 1992), in the order of their lower bounds.

    Parameters
    ----------
    problem : Problem
    rotations : ndarray, shape (m, d, d)
    num_steps : int
        Steps of ICP; none by default.

    Returns
    -------
    rotations : ndarray, shape (m, d, d)
    bounds : ndarray, shape (m,)
        The lower bounds of the energies, ascending.
    """
    nearest = NearestCosts(problem)
    for _ in range(num_steps):
        rotations = nearest.step(rotations)
    bounds = nearest.lower_bounds(rotations)
    order = np.argsort(bounds, kind="stable")
    return rotations[order], bounds[order]


#: Largest number of principal-axis starts; 4 in three dimensions.
_MAX_SIGN_STARTS = 16
#: Sizes of sets of rotations of blocks of so many dimensions; of more as in three. Up to three dimensions they cover
#: the group. Beyond, a step of nearest-neighbour ICP comes first; measured up to seven dimensions on random points.
_NUM_COVERING, _NUM_MORE = {2: 96, 3: 500}, {4: 4000, 5: 4000, 6: 16_000, 7: 16_000}
MAX_COVERED_DIM, MAX_SEARCHED_DIM = max(_NUM_COVERING), max(_NUM_MORE)
#: Poses closer than this are one.
_SAME_RAD = np.deg2rad(4.0)
#: Share of the rotations that meet exact assignment where they cover what is searched, and where they do not (higher
#: dimensions); for so many steps; share of these that are minimised to the end.
_TRIED, _TRIED_UNCOVERED, _TRIAL_STEPS, _KEPT = 0.07, 0.16, 1, 0.25
#: So many rotations go on at each of these steps at least; of two chiralities, each has at least this share of them.
_LEAST, _CHIRALITY_SHARE = 20, 0.25
#: The second look: around how many distinct minima, up to which multiple of the least energy, with how many rotations
#: each, by which angle.
_NUM_CENTRES, _CENTRE_FACTOR, _NUM_AROUND, _ANGLE_AROUND_RAD = 6, 1.25, 12, np.deg2rad(15.0)


def mirror_points(points: FloatArray) -> FloatArray:
    """Return points (..., d) with the first coordinate negated."""
    mirrored = points.copy()
    mirrored[..., 0] *= -1.0
    return mirrored


#: Negates the first column of matrices: composes a pose with the same mirror.
mirror_rotations = mirror_points


def leading_problem(problem: Problem) -> Problem:
    """Return the problem in the coordinates of the rotation block alone, constant costs included."""
    block = problem.pattern.rotation_block
    if block == problem.dim:
        return problem
    pattern = RotationPattern(
        read_only(problem.pattern.mask[:block, :block].copy()), problem.pattern.special_blocks[:1]
    )
    return replace(
        problem,
        target=read_only(np.ascontiguousarray(problem.target[:, :block])),
        source=read_only(np.ascontiguousarray(problem.source[:, :block])),
        pattern=pattern,
    )


@one_blas_thread()
def explore(problem: Problem, *, seed: int = 0) -> LocalMinima:
    """Return local minima found from the principal axes and an even set of rotations.

    Lower bounds rank all rotations; the most promising ones take a step with exact assignment; the best distinct ones
    of these are minimised to the end. The set is laid in the frames of the principal axes, so that the answer
    rotates with the points.

    Parameters
    ----------
    problem : Problem
        Where its group has reflections, both chiralities are searched.
    seed : int
        For rotation blocks of more than three dimensions.
    """
    lead = leading_problem(problem)
    num = (_NUM_COVERING | _NUM_MORE).get(lead.dim, _NUM_COVERING[MAX_COVERED_DIM])
    axes, even = initial_rotations(lead, num, seed=seed)
    is_covered = lead.dim <= MAX_COVERED_DIM
    num_tried = max(_LEAST, round((_TRIED if is_covered else _TRIED_UNCOVERED) * num))
    tried = _screened(lead, axes, even, num_tried)
    starts = np.concatenate([axes, tried])
    origins = np.repeat(["axes", "search"], [len(axes), len(tried)])
    if lead is not problem:
        starts = procrustes(
            problem, MatchingCosts(lead).assign(starts), lead.pattern.mirrored(starts)
        )
    trials = minimise(
        problem, starts, max_iterations=_TRIAL_STEPS, hold_chirality=True, origins=origins
    )
    num_kept = max(_LEAST, round(_KEPT * num_tried))
    kept = apart_rotations(
        trials.rotations[:, : lead.dim, : lead.dim],
        _SAME_RAD,
        num_kept,
        mirrored=problem.pattern.mirrored(trials.rotations),
    )
    return minimise(
        problem, trials.rotations[kept], hold_chirality=True, origins=trials.origins[kept]
    )


def initial_rotations(
    problem: Problem, num: int, *, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Return the principal-axis starts (a, d, d) and the even set, ``num`` rotations of each chirality of the group.

    Parameters
    ----------
    problem : Problem
        In the coordinates of the rotation block (:func:`leading_problem`).
    num : int
    seed : int
        For more than three dimensions.
    """
    axes, even = _standard_rotations(problem.dim, num, seed)
    is_full = bool(problem.pattern.mask.all())
    if not is_full:
        signs = sign_rotations(problem.dim, num, seed=seed)
        even = np.concatenate(
            [signs, problem.pattern.project(even, np.zeros(len(even), dtype=bool))]
        )
    found = []
    for reflected in (False,) if problem.pattern.special_blocks else (False, True):
        rotated = axes, even
        if is_full:
            source = mirror_points(problem.source) if reflected else problem.source
            left = principal_frame(problem.target, np.ones(problem.num_target))
            right = principal_frame(source, problem.weights)
            rotated = left @ axes @ right.T, left @ even @ right.T
        found.append(
            [mirror_rotations(rotations) for rotations in rotated] if reflected else rotated
        )
    return np.concatenate([rotations[0] for rotations in found]), np.concatenate(
        [rotations[1] for rotations in found]
    )


@lru_cache(maxsize=16)
def _standard_rotations(dim: int, num: int, seed: int) -> tuple[FloatArray, FloatArray]:
    return read_only(sign_rotations(dim, _MAX_SIGN_STARTS, seed=seed)), read_only(
        rotation_set(dim, num, seed=seed)
    )


@lru_cache(maxsize=16)
def _rotations_around(dim: int, seed: int) -> FloatArray:
    return read_only(small_rotations(dim, _NUM_AROUND, _ANGLE_AROUND_RAD, seed=seed))


def _screened(problem: Problem, axes: FloatArray, even: FloatArray, num: int) -> FloatArray:
    """Return the most promising rotations."""
    if problem.dim <= MAX_COVERED_DIM:
        rotations, _ = screen(problem, even)
        return rotations[_first(num, len(rotations), problem.pattern.mirrored(rotations))]
    rotations, _ = screen(problem, np.concatenate([axes, even]), num_steps=1)
    return rotations[
        apart_rotations(rotations, _SAME_RAD, num, mirrored=problem.pattern.mirrored(rotations))
    ]


def _first(num: int, num_all: int, mirrored: BoolArray | None) -> IntArray:
    """Return the first ``num`` positions of all, and the first ones of each chirality up to its share."""
    goes_on = np.arange(num_all) < num
    if mirrored is not None:
        rank = np.where(mirrored, np.cumsum(mirrored), np.cumsum(~mirrored))
        goes_on |= rank <= _CHIRALITY_SHARE * num
    return np.flatnonzero(goes_on)


@one_blas_thread()
def look_around(problem: Problem, minima: LocalMinima, *, seed: int = 0) -> LocalMinima:
    """Return the minima and those found by rotating the best distinct ones a little: many basins are small.

    Parameters
    ----------
    problem : Problem
    minima : LocalMinima
        Best first; only those not far above the first are worth the look.
    seed
        As in :func:`explore`.
    """
    block = problem.pattern.rotation_block
    centres = apart_rotations(
        minima.rotations[:, :block, :block], _ANGLE_AROUND_RAD / 2.0, _NUM_CENTRES
    )
    centres = centres[minima.energies[centres] <= _CENTRE_FACTOR * minima.energies[0]]
    rotations = np.tile(np.eye(problem.dim), (_NUM_AROUND, 1, 1))
    rotations[:, :block, :block] = _rotations_around(block, seed)
    starts = (rotations @ minima.rotations[centres, None]).reshape(-1, problem.dim, problem.dim)
    found = minimise(problem, starts, hold_chirality=True, origins="around")
    return merge([minima, found])


def apart_rotations(
    rotations: FloatArray, angle_rad: float, num: int, *, mirrored: BoolArray | None = None
) -> IntArray:
    """Return which rotations (m, d, d) a search goes on with: the first ``num`` that are ``angle_rad`` apart.

    Where it is known which ones are mirrored, the first ones of each chirality follow up to its share of ``num``.
    """
    flat = rotations.reshape(len(rotations), -1)
    free = np.ones(len(rotations), dtype=bool)
    kept: list[int] = []
    traces = rotations.shape[-1] - 2.0 * (1.0 - np.cos(angle_rad))
    sides = [0] * len(rotations) if mirrored is None else mirrored.astype(int).tolist()
    wanted = [0, 0] if mirrored is None else [round(_CHIRALITY_SHARE * num)] * 2
    for position in range(len(rotations)):
        if len(kept) >= num and max(wanted) <= 0:
            break
        if free[position] and (len(kept) < num or wanted[sides[position]] > 0):
            kept.append(position)
            wanted[sides[position]] -= 1
            free &= flat @ flat[position] <= traces
    return np.array(kept, dtype=np.int64)
