"""Cheap screening of many rotations: nearest-neighbour ICP of all rotations at once, in single precision.

Exact assignment costs about k^3, nearest neighbours k n: they take most rotations most of the way, and the sum of the
nearest distances, a lower bound of the assignment's cost, tells which are worth exact assignment.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray
from pairwise.problem import Problem

Singles: TypeAlias = NDArray[np.float32]

#: Entries of the cost matrices that are held at once.
_CHUNK_ENTRIES = 50_000


class NearestCosts:
    """Nearest neighbours under the matching costs, for batches of rotations.

    Where k = n both directions count: every target point is matched as well.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.both_ways = problem.num_source == problem.num_target and not problem.max_unmatched
        weights = problem.weights[:, None]
        fixed = weights * ((problem.target**2).sum(axis=1) + (problem.source**2).sum(axis=1, keepdims=True))
        fixed = np.where(problem.candidates.T, fixed + problem.constant_cost.T, np.inf)
        self._fixed = np.ascontiguousarray(fixed, dtype=np.float32)
        self._fixed_t = np.ascontiguousarray(fixed.T, dtype=np.float32)
        self._target = problem.target.astype(np.float32)
        self._target_t = np.ascontiguousarray(self._target.T)
        self._source = (-2.0 * weights * problem.source).astype(np.float32)
        self._source_t = np.ascontiguousarray(self._source.T)
        self.chunk = max(1, _CHUNK_ENTRIES // fixed.size)

    def step(self, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return one step's improved rotations (m, d, d), and the given ones' scores (m,)."""
        parts = [
            self._step(rotations[first : first + self.chunk].astype(np.float32))
            for first in range(0, len(rotations), self.chunk)
        ]
        moments = np.concatenate([part[0] for part in parts])
        return self.problem.pattern.project(moments), np.concatenate([part[1] for part in parts])

    def _step(self, rotations: Singles) -> tuple[FloatArray, FloatArray]:
        problem = self.problem
        m, k, n = len(rotations), problem.num_source, problem.num_target
        moved = self._source @ np.swapaxes(rotations, 1, 2)
        costs = (moved.reshape(m * k, -1) @ self._target_t).reshape(m, k, n)
        costs += self._fixed
        nearest = costs.argmin(axis=2)
        values = _taken(costs, nearest)
        weighted = problem.weights[:, None] * problem.source
        if problem.max_unmatched:
            values, is_matched = self._trimmed(values)
            moments = np.swapaxes(problem.target[nearest] * is_matched[:, :, None], 1, 2) @ weighted
            return moments, values.sum(axis=1)
        moments = np.swapaxes(problem.target[nearest], 1, 2) @ weighted
        if self.both_ways:
            back = (self._target @ rotations).reshape(m * n, -1)
            costs = (back @ self._source_t).reshape(m, n, k)
            costs += self._fixed_t
            nearest = costs.argmin(axis=2)
            values = np.concatenate([values, _taken(costs, nearest)], axis=1)
            moments += problem.target.T @ weighted[nearest]
        return moments, values.sum(axis=1)

    def _trimmed(self, values: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Leave the dearest points unmatched: the costs after that, and which points are matched (m, k)."""
        problem = self.problem
        num_matches = problem.num_source - problem.max_unmatched
        if num_matches == 0:
            is_matched = values < problem.unmatched_cost
        else:
            is_matched = np.zeros(values.shape, dtype=bool)
            np.put_along_axis(is_matched, np.argsort(values, axis=1, kind="stable")[:, :num_matches], True, axis=1)
        return np.where(is_matched, values, problem.unmatched_cost), is_matched


def _taken(costs: NDArray[np.floating[Any]], nearest: NDArray[np.intp]) -> FloatArray:
    return np.take_along_axis(costs, nearest[:, :, None], axis=2)[:, :, 0].astype(np.float64)


def screen(problem: Problem, rotations: FloatArray, *, num_steps: int = 2) -> tuple[FloatArray, FloatArray]:
    """Return rotations improved by nearest-neighbour ICP, best score first, and their scores.

    Parameters
    ----------
    problem : Problem
    rotations : ndarray, shape (m, d, d)
    num_steps : int
        Steps of ICP (Besl and McKay 1992).

    Returns
    -------
    rotations : ndarray, shape (m, d, d)
    scores : ndarray, shape (m,)
        The sum of the nearest costs, in both directions where k = n.
    """
    nearest = NearestCosts(problem)
    for _ in range(num_steps):
        rotations, _ = nearest.step(rotations)
    _, scores = nearest.step(rotations)
    order = np.argsort(scores, kind="stable")
    return rotations[order], scores[order]
