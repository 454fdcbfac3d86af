"""Cheap screening of many rotations: nearest-neighbour ICP of all rotations at once, in single precision.

Exact assignment costs about k^3, nearest neighbours k n: they take most rotations most of the way, and the sum of the
nearest distances, a lower bound of the assignment's cost, tells which are worth exact assignment.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray, IntArray
from pairwise.local_search import RIGID, Freedom, similarities
from pairwise.problem import Problem

Singles: TypeAlias = NDArray[np.float32]

#: Entries of the cost matrices that are held at once.
_CHUNK_ENTRIES = 50_000


class NearestCosts:
    """Nearest neighbours under the matching costs, for batches of poses.

    Where k = n both directions count, because every target point is matched as well. In partial matching the dearest
    points stay unmatched (trimmed ICP, Chetverikov et al. 2002). Scales stay 1.

    Parameters
    ----------
    problem : Problem
    translate : bool
        Shift the source as well; one direction only then.
    """

    def __init__(self, problem: Problem, *, translate: bool = False) -> None:
        self.problem = problem
        self.freedom = Freedom(translate=translate)
        is_full = problem.num_source == problem.num_target and not problem.max_unmatched
        self.both_ways = is_full and not translate
        self._unit = _size(problem)
        weights = problem.weights[:, None] / problem.weights.max()
        self._unit_cost = self._unit**2 * problem.weights.max()
        target, source = problem.target / self._unit, problem.source / self._unit
        constant = problem.constant_cost.T / self._unit_cost
        fixed = np.where(problem.candidates.T, weights * (target**2).sum(axis=1) + constant, np.inf)
        source_squares = weights * (source**2).sum(axis=1, keepdims=True)
        self._fixed = np.ascontiguousarray(fixed, dtype=np.float32)
        self._fixed_t = np.ascontiguousarray((fixed + source_squares).T, dtype=np.float32)
        self._target = target.astype(np.float32)
        self._target_t = np.ascontiguousarray(self._target.T)
        self._source = source.astype(np.float32)
        self._source_t = np.ascontiguousarray((-2.0 * weights * source).T, dtype=np.float32)
        self._weights = weights[:, 0].astype(np.float32)
        self.chunk = max(1, _CHUNK_ENTRIES // fixed.size)

    def step(self, rotations: FloatArray, shifts: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return one step's improved rotations (m, d, d) and shifts (m, d), and the given poses' scores (m,)."""
        parts = [slice(first, first + self.chunk) for first in range(0, len(rotations), self.chunk)]
        found = [self._nearest(rotations[part].astype(np.float32), shifts[part]) for part in parts]
        maps, moments, scores = (np.concatenate(columns) for columns in zip(*found, strict=True))
        if not self.both_ways:
            rotations, _, shifts = similarities(self.problem, maps, self.freedom)
            return rotations, shifts, scores
        weighted = self.problem.weights[:, None] * self.problem.source
        moments += np.swapaxes(self.problem.target[maps], 1, 2) @ weighted
        return self.problem.pattern.project(moments), shifts, scores

    def _nearest(self, rotations: Singles, shifts: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the nearest target points (m, k), the moments of the reverse direction, and the scores."""
        problem = self.problem
        m, k, n, d = len(rotations), problem.num_source, problem.num_target, problem.dim
        moved = self._source @ np.swapaxes(rotations, 1, 2)
        moved += (shifts[:, None, :] / self._unit).astype(np.float32)
        squares = self._weights * (moved**2).sum(axis=2)
        moved *= -2.0 * self._weights[:, None]
        costs = (moved.reshape(m * k, d) @ self._target_t).reshape(m, k, n)
        costs += self._fixed
        nearest = costs.argmin(axis=2)
        values = self._unit_cost * (_taken(costs, nearest) + squares)
        if problem.max_unmatched:
            values, is_matched = self._trimmed(values)
            nearest = np.where(is_matched, nearest, -1)
        if not self.both_ways:
            return nearest, np.zeros((m, d, d)), values.sum(axis=1)
        costs = ((self._target @ rotations).reshape(m * n, d) @ self._source_t).reshape(m, n, k)
        costs += self._fixed_t
        back = costs.argmin(axis=2)
        moments = problem.target.T @ (problem.weights[:, None] * problem.source)[back]
        return nearest, moments, values.sum(axis=1) + self._unit_cost * _taken(costs, back).sum(axis=1)

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


def _size(problem: Problem) -> float:
    """Return a length that brings the points into the range of single precision; 1 if all are at the origin."""
    return float(max(np.abs(problem.target).max(), np.abs(problem.source).max())) or 1.0


def _taken(costs: NDArray[np.floating[Any]], nearest: NDArray[np.intp]) -> FloatArray:
    rows = np.arange(nearest.size) * costs.shape[2]
    return costs.reshape(-1)[rows + nearest.reshape(-1)].reshape(nearest.shape).astype(np.float64)


def screen(
    problem: Problem,
    rotations: FloatArray,
    *,
    num_steps: int = 1,
    freedom: Freedom = RIGID,
    shifts: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return poses improved by nearest-neighbour ICP (Besl and McKay 1992), best score first.

    Parameters
    ----------
    problem : Problem
    rotations : ndarray, shape (m, d, d)
    num_steps : int
        Steps of ICP, at least one.
    freedom : Freedom
        Whether to shift as well; scales are not estimated here.
    shifts : ndarray, shape (m, d), optional
        The shifts to start with; 0 by default.

    Returns
    -------
    rotations : ndarray, shape (m, d, d)
    shifts : ndarray, shape (m, d)
    scores : ndarray, shape (m,)
        The sum of the nearest costs before the last step, in both directions where k = n.
    """
    nearest = NearestCosts(problem, translate=freedom.translate)
    shifts = np.zeros(rotations.shape[:2]) if shifts is None else shifts
    for _ in range(num_steps):
        rotations, shifts, scores = nearest.step(rotations, shifts)
    order = np.argsort(scores, kind="stable")
    return rotations[order], shifts[order], scores[order]
