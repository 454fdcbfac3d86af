"""Cheap screening of many poses at once, in single precision: which are worth exact assignment.

Exact assignment costs about k^3, nearest neighbours k n: the sum of the nearest distances is a lower bound of the
assignment's cost that ranks poses well, and nearest-neighbour ICP takes poses most of the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray, IntArray
from pairwise.local.freedom import RIGID, Freedom
from pairwise.local.local_search import similarities
from pairwise.problem.problem import Problem

Singles: TypeAlias = NDArray[np.float32]

#: Entries of the cost matrices that are held at once, and poses at least: fast are batches that fit the cache.
_CHUNK_ENTRIES, _LEAST_CHUNK = 50_000, 48


class NearestCosts:
    """Nearest neighbours under the matching costs, for batches of poses; the pose is the last index of costs.

    Where k = n both directions count, because every target point is matched as well. In partial matching the dearest
    points stay unmatched (trimmed ICP, Chetverikov et al. 2002). Scales stay 1.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.both_ways = problem.num_source == problem.num_target and not problem.max_unmatched
        self._unit = _size(problem)
        weights = problem.weights / problem.weights.max()
        self._unit_cost = self._unit**2 * problem.weights.max()
        target, source = problem.target / self._unit, problem.source / self._unit
        fixed = weights * (target**2).sum(axis=1)[:, None] + problem.constant_cost / self._unit_cost
        self._fixed = np.where(problem.allowed, fixed, np.inf).astype(np.float32)[:, :, None]
        self._target = target.astype(np.float32)
        self._source_t = np.ascontiguousarray(source.T, dtype=np.float32)
        self._weights = weights.astype(np.float32)[:, None]
        self.chunk = max(_LEAST_CHUNK, _CHUNK_ENTRIES // fixed.size)

    def lower_bounds(self, rotations: FloatArray, shifts: FloatArray | None = None) -> FloatArray:
        """Return lower bounds of the least energy of poses, shape (m,), from rotations (m, d, d) and shifts (m, d).

        It is the sum of the cheapest allowed costs of the source points, or the mean of this and of that of the
        target points where both count.
        """
        return np.concatenate([self._bounds(costs) for costs in self._costs(rotations, shifts)])

    def step(
        self, rotations: FloatArray, shifts: FloatArray, freedom: Freedom = RIGID
    ) -> tuple[FloatArray, FloatArray]:
        """Return the rotations (m, d, d) and shifts (m, d) after a step of ICP, of the chirality that they have.

        Both directions count as in :meth:`lower_bounds`, but for shifts the sources' nearest points alone.
        """
        problem = self.problem
        mirrored = problem.pattern.mirrored(rotations)
        if not self.both_ways or freedom.translate:
            maps = np.concatenate([self._nearest(costs) for costs in self._costs(rotations, shifts)])
            rotations, _, shifts = similarities(problem, maps, freedom, mirrored)
            return rotations, shifts
        found = [(costs.argmin(axis=0).T, costs.argmin(axis=1).T) for costs in self._costs(rotations, shifts)]
        maps, backs = (np.concatenate(columns) for columns in zip(*found, strict=True))
        weighted = problem.weights[:, None] * problem.source
        moments = np.swapaxes(problem.target[maps], 1, 2) @ weighted + problem.target.T @ weighted[backs]
        return problem.pattern.project(moments, mirrored), shifts

    def _costs(self, rotations: FloatArray, shifts: FloatArray | None) -> Iterator[Singles]:
        """Yield the costs (n, k, m) of as many poses at a time as fit the cache."""
        for first in range(0, len(rotations), self.chunk):
            part = slice(first, first + self.chunk)
            turns = rotations[part].astype(np.float32)
            m, d = turns.shape[:2]
            moved = (turns.reshape(m * d, d) @ self._source_t).reshape(m, d, -1)
            if shifts is not None:
                moved += (shifts[part] / self._unit).astype(np.float32)[:, :, None]
            moved = np.ascontiguousarray(moved.transpose(1, 2, 0))
            squares = self._weights * (moved**2).sum(axis=0)
            moved *= -2.0 * self._weights
            costs = (self._target @ moved.reshape(d, -1)).reshape(len(self._target), -1, m)
            costs += self._fixed
            costs += squares
            yield costs

    def _bounds(self, costs: Singles) -> FloatArray:
        values = self._unit_cost * costs.min(axis=0).astype(np.float64)
        if self.problem.max_unmatched:
            values = np.where(self._is_matched(values), values, self.problem.unmatched_cost)
        bounds = values.sum(axis=0)
        if not self.both_ways:
            return bounds
        return 0.5 * (bounds + self._unit_cost * costs.min(axis=1).astype(np.float64).sum(axis=0))

    def _nearest(self, costs: Singles) -> IntArray:
        """Return the nearest target points (m, k), -1 for the dearest in partial matching."""
        nearest = costs.argmin(axis=0)
        if self.problem.max_unmatched:
            values = self._unit_cost * costs.min(axis=0).astype(np.float64)
            nearest = np.where(self._is_matched(values), nearest, -1)
        return np.ascontiguousarray(nearest.T)

    def _is_matched(self, values: FloatArray) -> BoolArray:
        """Return which points (k, m) have a match, by their nearest costs."""
        problem = self.problem
        num_matches = problem.num_source - problem.max_unmatched
        if num_matches == 0:
            return values < problem.unmatched_cost
        is_matched = np.zeros(values.shape, dtype=bool)
        np.put_along_axis(is_matched, np.argsort(values, axis=0, kind="stable")[:num_matches], True, axis=0)
        return is_matched


def _size(problem: Problem) -> float:
    """Return a length that brings the points into the range of single precision; 1 if all are at the origin."""
    return float(max(np.abs(problem.target).max(), np.abs(problem.source).max())) or 1.0


def screen(
    problem: Problem,
    rotations: FloatArray,
    *,
    num_steps: int = 0,
    freedom: Freedom = RIGID,
    shifts: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return poses, improved by nearest-neighbour ICP (Besl and McKay 1992), in the order of their lower bounds.

    Parameters
    ----------
    problem : Problem
    rotations : ndarray, shape (m, d, d)
    num_steps : int
        Steps of ICP; none by default.
    freedom : Freedom
        Whether to shift as well; scales are not estimated here.
    shifts : ndarray, shape (m, d), optional
        The shifts to start with; 0 by default.

    Returns
    -------
    rotations : ndarray, shape (m, d, d)
    shifts : ndarray, shape (m, d)
    bounds : ndarray, shape (m,)
        The lower bounds of the energies, ascending.
    """
    nearest = NearestCosts(problem)
    freedom = Freedom(translate=freedom.translate)
    shifts = np.zeros(rotations.shape[:2]) if shifts is None else shifts
    for _ in range(num_steps):
        rotations, shifts = nearest.step(rotations, shifts, freedom)
    bounds = nearest.lower_bounds(rotations, shifts)
    order = np.argsort(bounds, kind="stable")
    return rotations[order], shifts[order], bounds[order]
