"""Alternating minimisation of the matching energy: exact assignment, then Procrustes, from many starts at once.

Maron et al. 2016, appendix A. Both steps solve their half of the problem exactly, so the energy never rises. The next
pose depends on the current map only; a run that meets a map of another run would end as that run does, so it stops
there, and what is returned are distinct local minima.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import FloatArray, IntArray
from pairwise.problem import Problem

#: Entries of the cost matrices that are held at once: what fits the processor's cache is fastest.
_CHUNK_ENTRIES = 50_000


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalMinima:
    """Distinct local minima, best energy first.

    Attributes
    ----------
    rotations : ndarray, shape (m, d, d)
    maps : ndarray of int, shape (m, k)
        -1 where a source point stays unmatched.
    energies : ndarray, shape (m,)
    scales : ndarray, shape (m,)
        Factor of the source points; 1 unless it was estimated.
    origins : ndarray of str, shape (m,)
        What gave the start whose run ended here.
    """

    rotations: FloatArray
    maps: IntArray
    energies: FloatArray
    scales: FloatArray
    origins: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.energies)

    def take(self, index: IntArray) -> LocalMinima:
        """Return the minima of the given positions in that order."""
        return LocalMinima(
            rotations=self.rotations[index],
            maps=self.maps[index],
            energies=self.energies[index],
            scales=self.scales[index],
            origins=self.origins[index],
        )


class MatchingCosts:
    """The costs of all matches for batches of poses, prepared once per problem.

    Unlike :meth:`Problem.assignment_costs` the source points are rows, which is what the assignment solver wants, and
    partial matching adds ``max_unmatched`` columns for staying unmatched.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        weights = problem.weights[:, None]
        self._target_t = np.ascontiguousarray(problem.target.T)
        self._fixed = weights * (problem.target**2).sum(axis=1) + problem.constant_cost.T
        self._fixed = np.where(problem.candidates.T, self._fixed, np.inf)
        self._source_squares = weights * (problem.source**2).sum(axis=1, keepdims=True)
        self._weighted_source = -2.0 * weights * problem.source
        self.chunk = max(1, _CHUNK_ENTRIES // (problem.num_source * (problem.num_target + problem.max_unmatched)))

    def __call__(self, rotations: FloatArray, scales: FloatArray) -> FloatArray:
        """Return costs of shape (m, k, n) for rotations (m, d, d) and scales (m,)."""
        scale = scales[:, None, None]
        moved = self._weighted_source @ np.swapaxes(rotations * scale, 1, 2)
        m, k, d = moved.shape
        costs = (moved.reshape(m * k, d) @ self._target_t).reshape(m, k, -1)
        costs += self._fixed
        costs += self._source_squares * scale**2
        return costs

    def assign(self, rotations: FloatArray, scales: FloatArray) -> IntArray:
        """Return the best map of each pose, shape (m, k), by exact assignment."""
        problem = self.problem
        maps = np.empty((len(rotations), problem.num_source), dtype=np.int64)
        for first in range(0, len(rotations), self.chunk):
            part = slice(first, first + self.chunk)
            for row, cost in enumerate(self._prepared(self(rotations[part], scales[part])), start=first):
                maps[row] = linear_sum_assignment(cost)[1]
        maps[maps >= problem.num_target] = -1
        return maps

    def _prepared(self, costs: FloatArray) -> FloatArray:
        """Return costs with the same best maps that the assignment solver is faster at.

        Rows and, where every column is used, columns are reduced by their minima: the solver starts from dual
        variables zero, and these are better ones. Columns for staying unmatched are appended; where the number of
        matches is fixed these are cheaper than any match, so that all of them are used.
        """
        spare = self.problem.max_unmatched
        if not spare:
            costs -= costs.min(axis=2, keepdims=True)
            if costs.shape[1] == costs.shape[2]:
                costs -= costs.min(axis=1, keepdims=True)
            return costs
        is_fixed = spare < self.problem.num_source
        price = np.min(costs, initial=0.0) - 1.0 if is_fixed else self.problem.unmatched_cost
        columns = np.full((*costs.shape[:2], spare), price)
        return np.concatenate([costs, columns], axis=2)


def procrustes(
    problem: Problem, maps: IntArray, *, scale_range: tuple[float, float] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the best pose for each map: rotations (m, d, d) and scales (m,).

    Parameters
    ----------
    problem : Problem
    maps : ndarray of int, shape (m, k)
    scale_range : pair of float, optional
        Estimate the source's scale as well, within these limits; 1 otherwise.
    """
    weights = np.where(maps >= 0, problem.weights, 0.0)
    images = np.swapaxes(problem.target[maps] * weights[:, :, None], 1, 2)
    moments = images @ problem.source
    rotations = problem.pattern.project(moments)
    if scale_range is None:
        return rotations, np.ones(len(maps))
    size = (weights * (problem.source**2).sum(axis=1)).sum(axis=1)
    overlap = (rotations * moments).sum(axis=(1, 2))
    scales = np.divide(overlap, size, out=np.ones_like(size), where=size > 0)
    return rotations, np.clip(scales, *scale_range)


def energies_of(problem: Problem, rotations: FloatArray, maps: IntArray, scales: FloatArray) -> FloatArray:
    """Return the energy of every pose and map from the differences themselves, shape (m,)."""
    matched = maps >= 0
    moved = problem.source @ np.swapaxes(rotations * scales[:, None, None], 1, 2)
    squares = ((moved - problem.target[maps]) ** 2).sum(axis=2) * problem.weights
    constant = problem.constant_cost[maps, np.arange(problem.num_source)]
    return np.where(matched, squares + constant, problem.unmatched_cost).sum(axis=1)


def minimise(
    problem: Problem,
    rotations: FloatArray,
    *,
    tol: float = 1e-6,
    max_iterations: int = 100,
    scale_range: tuple[float, float] | None = None,
    origins: str | NDArray[np.str_] = "start",
) -> LocalMinima:
    """Descend from every rotation to a local minimum of the energy.

    Parameters
    ----------
    problem : Problem
    rotations : ndarray, shape (m, d, d)
        The starts.
    tol : float
        A run ends when its energy falls by less than this, relative, or its map stays the same.
    max_iterations : int
        Most alternations of a run.
    scale_range : pair of float, optional
        Estimate the source's scale too, within these limits.
    origins : str or ndarray of str, shape (m,)
        What gave the starts.

    Returns
    -------
    LocalMinima
        The distinct ends of the runs: runs that meet are one.
    """
    costs = MatchingCosts(problem)
    runs = np.arange(len(rotations))
    names = np.broadcast_to(np.asarray(origins, dtype=np.str_), len(runs))
    scales, energies = np.ones(len(runs)), np.full(len(runs), np.inf)
    seen: dict[bytes, int] = {}
    ends: list[LocalMinima] = []
    for iteration in range(max_iterations):
        maps = costs.assign(rotations, scales)
        owners = np.array([seen.setdefault(row.tobytes(), run) for row, run in zip(maps, runs.tolist(), strict=True)])
        own = owners == runs
        rotations, scales = procrustes(problem, maps, scale_range=scale_range)
        previous, energies = energies, energies_of(problem, rotations, maps, scales)
        ended = previous - energies <= tol * energies
        if iteration == max_iterations - 1:
            ended[:] = True
        now = np.flatnonzero(ended & own)
        ends.append(
            LocalMinima(
                rotations=rotations[now],
                maps=maps[now],
                energies=energies[now],
                scales=scales[now],
                origins=names[runs[now]],
            )
        )
        rest = np.flatnonzero(~ended & own)
        if not len(rest):
            break
        runs, rotations, scales, energies = runs[rest], rotations[rest], scales[rest], energies[rest]
    return merge(ends)


def merge(parts: list[LocalMinima]) -> LocalMinima:
    """Return the minima of all parts, best energy first, those of equal maps once."""
    joined = LocalMinima(
        rotations=np.concatenate([p.rotations for p in parts]),
        maps=np.concatenate([p.maps for p in parts]),
        energies=np.concatenate([p.energies for p in parts]),
        scales=np.concatenate([p.scales for p in parts]),
        origins=np.concatenate([p.origins for p in parts]),
    )
    order = np.argsort(joined.energies, kind="stable")
    first: dict[bytes, int] = {}
    for position in order.tolist():
        first.setdefault(joined.maps[position].tobytes(), position)
    return joined.take(np.fromiter(first.values(), dtype=np.int64, count=len(first)))
