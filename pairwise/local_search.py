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
    shifts : ndarray, shape (m, d)
        Added to the turned source points; 0 unless it was estimated.
    origins : ndarray of str, shape (m,)
        What gave the start whose run ended here.
    """

    rotations: FloatArray
    maps: IntArray
    energies: FloatArray
    scales: FloatArray
    shifts: FloatArray
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
            shifts=self.shifts[index],
            origins=self.origins[index],
        )


@dataclass(frozen=True, kw_only=True)
class Freedom:
    """What a pose may do beside turning.

    Attributes
    ----------
    scale_range : pair of float, or None
        Scale the source, within these limits.
    translate : bool
        Shift the source.
    """

    scale_range: tuple[float, float] | None = None
    translate: bool = False


#: Rotations only, as in Procrustes matching.
RIGID = Freedom()


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
        self._doubled_weights = -2.0 * weights
        self.chunk = max(1, _CHUNK_ENTRIES // (problem.num_source * (problem.num_target + problem.max_unmatched)))

    def __call__(self, rotations: FloatArray, scales: FloatArray, shifts: FloatArray | None = None) -> FloatArray:
        """Return costs of shape (m, k, n) for rotations (m, d, d), scales (m,) and shifts (m, d)."""
        moved = self.problem.source @ np.swapaxes(rotations * scales[:, None, None], 1, 2)
        if shifts is not None:
            moved += shifts[:, None, :]
        m, k, d = moved.shape
        squares = self.problem.weights * (moved**2).sum(axis=2)
        moved *= self._doubled_weights
        costs = (moved.reshape(m * k, d) @ self._target_t).reshape(m, k, -1)
        costs += self._fixed
        costs += squares[:, :, None]
        return costs

    def assign(self, rotations: FloatArray, scales: FloatArray, shifts: FloatArray | None = None) -> IntArray:
        """Return the best map of each pose, shape (m, k), by exact assignment."""
        problem = self.problem
        maps = np.empty((len(rotations), problem.num_source), dtype=np.int64)
        for first in range(0, len(rotations), self.chunk):
            part = slice(first, first + self.chunk)
            costs = self(rotations[part], scales[part], None if shifts is None else shifts[part])
            for row, cost in enumerate(self._prepared(costs), start=first):
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


def procrustes(problem: Problem, maps: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the best rotation for each map, shape (m, d, d), and scales of 1, shape (m,)."""
    rotations, scales, _ = similarities(problem, maps)
    return rotations, scales


def similarities(
    problem: Problem, maps: IntArray, freedom: Freedom = RIGID
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the best pose for each map (Umeyama 1991): rotations (m, d, d), scales (m,), shifts (m, d).

    Parameters
    ----------
    problem : Problem
    maps : ndarray of int, shape (m, k)
    freedom : Freedom
        Scales are 1 and shifts 0 unless they are free.
    """
    weights = np.where(maps >= 0, problem.weights, 0.0)
    images = problem.target[maps]
    moments = np.swapaxes(images * weights[:, :, None], 1, 2) @ problem.source
    size = (weights * (problem.source**2).sum(axis=1)).sum(axis=1)
    if freedom.translate:
        mass = np.maximum(weights.sum(axis=1), np.finfo(float).tiny)[:, None]
        mean_image = (images * weights[:, :, None]).sum(axis=1) / mass
        mean_source = weights @ problem.source / mass
        moments -= mass[:, :, None] * mean_image[:, :, None] * mean_source[:, None, :]
        size -= mass[:, 0] * (mean_source**2).sum(axis=1)
    rotations = problem.pattern.project(moments)
    scales = np.ones(len(maps))
    if freedom.scale_range is not None:
        overlap = (rotations * moments).sum(axis=(1, 2))
        scales = np.clip(np.divide(overlap, size, out=scales, where=size > 0), *freedom.scale_range)
    if not freedom.translate:
        return rotations, scales, np.zeros((len(maps), problem.dim))
    turned = (rotations @ mean_source[:, :, None])[:, :, 0]
    return rotations, scales, mean_image - scales[:, None] * turned


def energies_of(
    problem: Problem, rotations: FloatArray, maps: IntArray, scales: FloatArray, shifts: FloatArray | None = None
) -> FloatArray:
    """Return the energy of every pose and map from the differences themselves, shape (m,)."""
    moved = problem.source @ np.swapaxes(rotations * scales[:, None, None], 1, 2)
    if shifts is not None:
        moved += shifts[:, None, :]
    squares = ((moved - problem.target[maps]) ** 2).sum(axis=2) * problem.weights
    constant = problem.constant_cost[maps, np.arange(problem.num_source)]
    return np.where(maps >= 0, squares + constant, problem.unmatched_cost).sum(axis=1)


def minimise(
    problem: Problem,
    rotations: FloatArray,
    *,
    tol: float = 1e-6,
    max_iterations: int = 100,
    freedom: Freedom = RIGID,
    shifts: FloatArray | None = None,
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
    freedom : Freedom
        What is estimated beside the rotation.
    shifts : ndarray, shape (m, d), optional
        The shifts to start with; 0 by default.
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
    shifts = np.zeros((len(runs), problem.dim)) if shifts is None else shifts
    seen: dict[bytes, int] = {}
    ends: list[LocalMinima] = []
    for iteration in range(max_iterations):
        maps = costs.assign(rotations, scales, shifts if freedom.translate else None)
        owners = np.array([seen.setdefault(row.tobytes(), run) for row, run in zip(maps, runs.tolist(), strict=True)])
        own = owners == runs
        rotations, scales, shifts = similarities(problem, maps, freedom)
        previous, energies = energies, energies_of(problem, rotations, maps, scales, shifts)
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
                shifts=shifts[now],
                origins=names[runs[now]],
            )
        )
        rest = np.flatnonzero(~ended & own)
        if not len(rest):
            break
        runs, energies = runs[rest], energies[rest]
        rotations, scales, shifts = rotations[rest], scales[rest], shifts[rest]
    return merge(ends)


def merge(parts: list[LocalMinima]) -> LocalMinima:
    """Return the minima of all parts, best energy first, those of equal maps once."""
    joined = LocalMinima(
        rotations=np.concatenate([p.rotations for p in parts]),
        maps=np.concatenate([p.maps for p in parts]),
        energies=np.concatenate([p.energies for p in parts]),
        scales=np.concatenate([p.scales for p in parts]),
        shifts=np.concatenate([p.shifts for p in parts]),
        origins=np.concatenate([p.origins for p in parts]),
    )
    order = np.argsort(joined.energies, kind="stable")
    first: dict[bytes, int] = {}
    for position in order.tolist():
        first.setdefault(joined.maps[position].tobytes(), position)
    return joined.take(np.fromiter(first.values(), dtype=np.int64, count=len(first)))
