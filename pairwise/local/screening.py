"""Cheap screening of many poses at once, in single precision: which are worth exact assignment.

Exact assignment costs about k^3, nearest neighbours k n: the sum of the nearest distances is a lower bound of the
assignment's cost that ranks poses well, and nearest-neighbour ICP takes poses most of the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import FloatArray
from pairwise.local.local_search import procrustes
from pairwise.problem.problem import Problem

Singles: TypeAlias = NDArray[np.float32]

#: Entries of the cost matrices that are held at once, and poses at least: fast are batches that fit the cache.
_CHUNK_ENTRIES, _LEAST_CHUNK = 50_000, 48


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
        self._source_t = np.ascontiguousarray((-2.0 * weights[:, None] * source).T, dtype=np.float32)
        self.chunk = max(_LEAST_CHUNK, _CHUNK_ENTRIES // fixed.size)

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
        found = [(costs.argmin(axis=0).T, costs.argmin(axis=1).T) for costs in self._costs(rotations)]
        maps, backs = (np.concatenate(columns) for columns in zip(*found, strict=True))
        weighted = problem.weights[:, None] * problem.source
        moments = np.swapaxes(problem.target[maps], 1, 2) @ weighted + problem.target.T @ weighted[backs]
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
        while (half := (costs.shape[1] + 1) // 2) < costs.shape[1]:  # faster than minima of many short rows
            costs = np.minimum(costs[:, :half], costs[:, -half:])
        return 0.5 * (bounds + self._unit_cost * costs[:, 0].astype(np.float64).sum(axis=0))


def _size(problem: Problem) -> float:
    """Return a length that brings the points into the range of single precision; 1 if all are at the origin."""
    return float(max(np.abs(problem.target).max(), np.abs(problem.source).max())) or 1.0


def screen(problem: Problem, rotations: FloatArray, *, num_steps: int = 0) -> tuple[FloatArray, FloatArray]:
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
