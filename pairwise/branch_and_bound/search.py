"""Best-first branch and bound over the rotations of one chirality."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, Rows
from pairwise.branch_and_bound.bounds import Cells, QuasiBounds, radii_of
from pairwise.certificates.verify_cells import DEEPEST
from pairwise.local_search import minimise
from pairwise.problem import Problem, energy_scale, mirror

#: Entries of the cost matrices of the cells that are split at once, and cells at most.
_BATCH_ENTRIES, _MOST_CELLS = 4_000_000, 512
#: Halvings of a cell before its parts are bounded.
_MOST_SPLITS = 3
#: Poses at cell centres from which each batch looks for a better one, where their own energies are lower.
_NUM_DESCENTS = 2
#: Relative to the energy's scale: what counts as no gap where the energy is zero.
_ZERO_GAP = 1e-9


class RotationSearch:
    """The cells that may still hold a pose that is sought, and the best pose so far.

    Sought is either a pose better than the best one by more than the tolerance, or, after :meth:`collect`, every pose
    that is best for its own map and within a factor of the best energy.

    Parameters
    ----------
    problem : Problem
        Over SO(2) or SO(3), its source already mirrored where ``reflected``.
    reflected : bool
    tol : float
        Relative gap at which a cell is settled.

    Attributes
    ----------
    energy, rotation, map
        The best pose found: its energy, R (d, d) of the problem given here, and map (k,).
    bound : float
        No pose of this chirality has a smaller energy.
    """

    def __init__(self, problem: Problem, *, reflected: bool, tol: float) -> None:
        self.problem = problem
        self.reflected = reflected
        self.signs = mirror(problem.dim) if reflected else np.ones(problem.dim)
        self.energy = np.inf
        self.num_cells = 0
        self.is_stuck = False
        self._tol = tol
        self._within, self._resolution_rad = 0.0, 0.0
        self._zero_gap = _ZERO_GAP * energy_scale(problem)
        self._settled_bound = np.inf
        self._floor = 0.0 if (problem.constant_cost >= 0).all() else -np.inf
        self._evaluate = QuasiBounds(problem)
        whole = Cells.whole(problem.dim)
        self._open = OpenCells(
            cells=whole,
            radii=np.full(len(whole), np.pi),
            bounds=np.full(len(whole), -np.inf),
            losses=np.ones(len(whole)),
            is_proven=np.ones(len(whole), dtype=np.bool_),
        )
        self._collected = self._open.take(np.zeros(0, dtype=np.int64))
        self._settled: list[OpenCells] = []

    @property
    def leaves(self) -> OpenCells:
        """All cells that were not split; they tile the rotations."""
        everything = self._open.join(self._collected)
        return everything.join(*self._settled)

    @property
    def bound(self) -> float:
        """The lower bound of this chirality: the least of all cells, or 0 where no match costs less."""
        waiting = np.append(self._open.proven_bounds, self._collected.proven_bounds)
        return max(self._floor, min(self._settled_bound, float(waiting.min(initial=np.inf))))

    def threshold(self, best: float) -> float:
        """Return the bound at which a cell is settled if ``best`` is the energy to beat.

        It lies below this chirality's own best energy by the tolerance, but need not exceed the other's: beyond that
        the mirror decision is proven.
        """
        if self._within:
            return self._within * best + self._zero_gap
        return min(self.energy * (1.0 - self._tol) - self._zero_gap, best + self._zero_gap)

    def is_done(self, best: float) -> bool:
        """Return whether nothing here can beat the energy ``best`` by more than the tolerance."""
        return self.bound >= self.threshold(best)

    def collect(self, within: float, resolution_rad: float) -> None:
        """Seek all poses of at most ``within`` times the best energy, in cells of at most that radius."""
        self._within, self._resolution_rad = within, resolution_rad

    def collected(self, best: float) -> OpenCells:
        """Return the cells that hold all of these poses, and seek a better one inside them from now on."""
        found = self._open.join(self._collected)
        is_sought = found.bounds < self.threshold(best)
        self._settled.append(found.take(np.flatnonzero(~is_sought)))
        found = found.take(np.flatnonzero(is_sought))
        self._within, self._resolution_rad, self.is_stuck = 0.0, 0.0, False
        self._open, self._collected = found, found.take(np.zeros(0, dtype=np.int64))
        return found

    def descend(self, rotations: FloatArray) -> None:
        """Minimise locally from rotations (m, d, d) and keep the best pose."""
        minima = minimise(self.problem, rotations)
        if minima.energies[0] < self.energy:
            self.energy = float(minima.energies[0])
            self.rotation, self.map = minima.rotations[0], minima.maps[0]

    def run(self, deadline: float, best: float) -> None:
        """Split cells until done, or until ``time.monotonic()`` passes the deadline.

        Parameters
        ----------
        deadline : float
        best : float
            Best energy of either chirality.
        """
        per_cell = self.problem.num_source * self.problem.num_target * 2
        batch = int(np.clip(_BATCH_ENTRIES // per_cell, 1, _MOST_CELLS))
        self._settle(min(best, self.energy))
        while len(self._open.bounds) and time.monotonic() < deadline:
            self._split(batch, min(best, self.energy))
            self._settle(min(best, self.energy))
        self._open, self._collected = self._proven(self._open), self._proven(self._collected)

    def _split(self, batch: int, best: float) -> None:
        """Replace the cells of least bound by their children."""
        num = len(self._open.bounds)
        order = np.argpartition(self._open.bounds, batch) if num > batch else np.arange(num)
        chosen, rest = self._open.take(order[:batch]), self._open.take(order[batch:])
        cells = self._parts(chosen, self.threshold(best))
        rotations, reach = cells.reach()
        bounds, losses, is_proven, energies = self._evaluate(rotations, reach, self.threshold(best))
        self.num_cells += len(cells)
        lowest = np.argsort(energies, kind="stable")[:_NUM_DESCENTS]
        lowest = lowest[energies[lowest] < self.energy]
        if len(lowest):
            self.descend(rotations[lowest])
        fresh = OpenCells(
            cells=cells, radii=radii_of(reach), bounds=bounds, losses=losses, is_proven=is_proven
        )
        self._open = rest.join(fresh)

    def _parts(self, chosen: OpenCells, threshold: float) -> Cells:
        """Split cells so often that a bound may exceed the threshold: three splits leave a fourth of the loss.

        Cells that are only collected are not split further than that takes.
        """
        left = np.maximum(chosen.bounds + chosen.losses - threshold, 1e-9 * chosen.losses)
        useful = 1.5 * np.log2(chosen.losses / left)
        small_enough = np.ceil(3.0 * np.log2(chosen.radii / max(self._resolution_rad, 1e-9)))
        times = np.clip(np.minimum(useful, small_enough), 1, _MOST_SPLITS).astype(np.int64)
        cells = chosen.cells
        for done in range(_MOST_SPLITS):
            ready, again = np.flatnonzero(times <= done), np.flatnonzero(times > done)
            cells = cells.take(ready).join(cells.take(again).split())
            times = np.concatenate([times[ready], np.repeat(times[again], 2)])
        return cells

    def _proven(self, cells: OpenCells) -> OpenCells:
        """Return cells with bounds for those that none was needed of."""
        at = np.flatnonzero(~cells.is_proven)
        bounds = cells.bounds.copy()
        bounds[at] = self._evaluate(*cells.cells.take(at).reach(), -np.inf)[0]
        return replace(cells, bounds=bounds, is_proven=np.ones_like(cells.is_proven))

    def _settle(self, best: float) -> None:
        """Set aside the cells that cannot hold a pose that is sought, or are too small to be split."""
        cells = self._open
        is_settled = cells.proven_bounds >= self.threshold(best)
        self._settled_bound = min(
            self._settled_bound, float(cells.bounds[is_settled].min(initial=np.inf))
        )
        self._settled.append(cells.take(np.flatnonzero(is_settled)))
        is_smallest = cells.cells.depths >= DEEPEST
        is_small = ~is_settled & (is_smallest | (cells.radii <= self._resolution_rad))
        self.is_stuck |= bool((is_small & is_smallest).any())
        self._collected = self._collected.join(cells.take(np.flatnonzero(is_small)))
        self._open = cells.take(np.flatnonzero(~is_settled & ~is_small))


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenCells(Rows):
    """The cells that a search has still open, with what is known about them.

    Attributes
    ----------
    cells : Cells
    radii : ndarray, shape (m,)
        Of the balls around them, in radians.
    bounds : ndarray, shape (m,)
        Quasi-bounds, each of its cell alone: a larger one of the cell that it was split off would hold as well, but
        does not show in the leaves, which is all that a certificate holds. Where nothing is proven, what could be.
    losses : ndarray, shape (m,)
        What the bounds lose to the size of the cells.
    is_proven : ndarray of bool, shape (m,)
    """

    cells: Cells
    radii: FloatArray
    bounds: FloatArray
    losses: FloatArray
    is_proven: BoolArray

    @property
    def proven_bounds(self) -> FloatArray:
        """The bounds (m,), ``-inf`` where nothing is proven."""
        return np.where(self.is_proven, self.bounds, -np.inf)
