"""Alternating minimisation of the matching energy: exact assignment, then Procrustes, from many starts at once.

Maron et al. 2016, appendix A. Both steps solve their half of the problem exactly, so the energy never rises. The next
pose depends on the current map only; a run that meets a map of another run would end as that run does, so it stops
there, and what is returned are distinct local minima.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import CACHED_ENTRIES, BoolArray, FloatArray, IntArray, Rows
from pairwise.problem import Problem


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalMinima(Rows):
    """Distinct local minima, best energy first.

    Attributes
    ----------
    rotations : ndarray, shape (m, d, d)
    maps : ndarray of int, shape (m, k)
    energies : ndarray, shape (m,)
    origins : ndarray of str, shape (m,)
        What gave the start whose run ended here.
    """

    rotations: FloatArray
    maps: IntArray
    energies: FloatArray
    origins: NDArray[np.str_]


class MatchingCosts:
    """The costs of all matches for batches of poses, prepared once per problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        fixed = problem.weights * (problem.target**2).sum(axis=1)[:, None] + problem.constant_cost
        self._fixed = np.where(problem.allowed, fixed, np.inf).T.copy()
        self._source = -2.0 * problem.weights[:, None] * problem.source
        self.chunk = max(1, CACHED_ENTRIES // (problem.num_source * problem.num_target))

    def __call__(self, rotations: FloatArray) -> FloatArray:
        """Return costs of shape (m, k, n) for rotations (m, d, d), but for a constant of each source point."""
        moved = self._source @ np.swapaxes(rotations, 1, 2)
        costs = (moved.reshape(-1, moved.shape[2]) @ self.problem.target.T).reshape(
            -1, *self._fixed.shape
        )
        costs += self._fixed
        return costs

    def assign(self, rotations: FloatArray, potentials: FloatArray | None = None) -> IntArray:
        """Return the best map of each pose, shape (m, k), by exact assignment.

        Parameters
        ----------
        rotations : ndarray, shape (m, d, d)
        potentials : ndarray, shape (m, n), optional
            Those of similar poses, from which each assignment starts; its own are written there.
        """
        from pairwise.branch_and_bound.exact_assignment import cheapest_matches

        maps = np.empty((len(rotations), self.problem.num_source), dtype=np.int64)
        if potentials is None:
            potentials = np.zeros((len(rotations), self.problem.num_target))
        for first in range(0, len(rotations), self.chunk):
            some = slice(first, first + self.chunk)
            cheapest_matches(self(rotations[some]), potentials[some], maps[some])
        return maps


def procrustes(problem: Problem, maps: IntArray, mirrored: BoolArray | None = None) -> FloatArray:
    """Return the best rotation for each map (m, k), shape (m, d, d).

    Their chirality is the group's, or ``mirrored`` (m,): :meth:`pairwise.rotation_pattern.RotationPattern.project`.
    """
    images = problem.target[maps] * problem.weights[:, None]
    return problem.pattern.project(np.swapaxes(images, 1, 2) @ problem.source, mirrored)


def energies_of(problem: Problem, rotations: FloatArray, maps: IntArray) -> FloatArray:
    """Return the energy of every pose and map from the differences themselves, shape (m,)."""
    moved = problem.source @ np.swapaxes(rotations, 1, 2)
    squares = ((moved - problem.target[maps]) ** 2).sum(axis=2) * problem.weights
    return np.asarray(
        (squares + problem.constant_cost[maps, np.arange(problem.num_source)]).sum(axis=1)
    )


def minimise(
    problem: Problem,
    rotations: FloatArray,
    *,
    max_iterations: int = 100,
    hold_chirality: bool = False,
    origins: str | NDArray[np.str_] = "start",
) -> LocalMinima:
    """Descend from every rotation to a local minimum of the energy.

    A run ends at the first map that it had before.

    Parameters
    ----------
    problem : Problem
    rotations : ndarray, shape (m, d, d)
        The starts.
    max_iterations : int
        Most alternations of a run.
    hold_chirality : bool
        Where the group has reflections: keep every run to the chirality of its start.
    origins : str or ndarray of str, shape (m,)
        What gave the starts.

    Returns
    -------
    LocalMinima
        The distinct ends of the runs: runs that meet are one.
    """
    costs = MatchingCosts(problem)
    num, seen = (
        len(rotations),
        _SeenMaps(problem.pattern.mirrored(rotations) if hold_chirality else None),
    )
    active, potentials = np.arange(num), np.zeros((num, problem.num_target))
    ends: list[tuple[IntArray, IntArray]] = []
    for iteration in range(1, max_iterations + 1):
        maps = costs.assign(rotations, potentials)
        is_own, is_new = seen.claim(maps, active)
        goes_on = is_new & (iteration < max_iterations)
        ended = is_own & ~goes_on
        if not goes_on.any() and not any(len(runs) for runs, _ in ends) and not ended.any():
            # The last runs swapped maps of equal energy: one of them stands for all.
            ended[0] = True
        ends.append((active[ended], maps[ended]))
        active, potentials = active[goes_on], potentials[goes_on]
        if not len(active):
            break
        rotations = procrustes(problem, maps[goes_on], seen.chirality(active))
    runs, maps = (np.concatenate(column) for column in zip(*ends, strict=True))
    rotations = procrustes(problem, maps, seen.chirality(runs))
    found = LocalMinima(
        rotations=rotations,
        maps=maps,
        energies=energies_of(problem, rotations, maps),
        origins=np.broadcast_to(np.asarray(origins, dtype=np.str_), num)[runs],
    )
    return found.take(np.argsort(found.energies, kind="stable"))


class _SeenMaps:
    """Which run had which map first; maps of runs of different chirality are different."""

    def __init__(self, mirrored: BoolArray | None) -> None:
        self.mirrored = mirrored
        self.first: dict[bytes, int] = {}

    def chirality(self, runs: IntArray) -> BoolArray | None:
        """Return the chirality (m,) that the runs (m,) hold, if any."""
        return None if self.mirrored is None else self.mirrored[runs]

    def claim(self, maps: IntArray, runs: IntArray) -> tuple[BoolArray, BoolArray]:
        """Return whether each run (m,) is the first with its map (m, k), and whether it has it for the first time."""
        mirrored = self.chirality(runs)
        labels = maps if mirrored is None else np.column_stack([mirrored, maps])
        sizes, owners = [len(self.first)], []
        for label, run in zip(_rows_as_bytes(labels), runs.tolist(), strict=True):
            owners.append(self.first.setdefault(label, run))
            sizes.append(len(self.first))
        return np.array(owners) == runs, np.diff(sizes) > 0


def _rows_as_bytes(array: IntArray) -> list[bytes]:
    joined, width = array.tobytes(), array.itemsize * array.shape[1]
    return [joined[first : first + width] for first in range(0, len(joined), width)]


def merge(parts: list[LocalMinima]) -> LocalMinima:
    """Return the minima of all parts, each in order, best energy first, those of equal maps and chirality once."""
    if len(parts) == 1:
        return parts[0]
    joined = parts[0].join(*parts[1:])
    order = np.argsort(joined.energies, kind="stable")
    labels = np.column_stack([np.linalg.det(joined.rotations) < 0, joined.maps])
    first: dict[bytes, int] = {}
    for label, position in zip(_rows_as_bytes(labels[order]), order.tolist(), strict=True):
        first.setdefault(label, position)
    return joined.take(np.fromiter(first.values(), dtype=np.int64, count=len(first)))
