"""Best-first branch and bound over the rotations of one chirality."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from data_tools.arrays import FloatArray, read_only
from pairwise.branch_and_bound.bounds import BallBounds
from pairwise.branch_and_bound.cells import Cells, join
from pairwise.local.local_search import minimise
from pairwise.problem.problem import Problem
from pairwise.tight.lift import make_lift
from pairwise.tight.problem import energy_scale, mirror
from pairwise.tight.run import TightRun

#: Entries of the cost matrices of the cells that are split at once.
_BATCH_ENTRIES = 1_000_000
#: Poses at cell centres from which each batch looks for a better one.
_NUM_DESCENTS = 2
#: Cells are not split below this half side: their rotations differ by 1e-6 rad.
_SMALLEST_HALF = 2.0**-21
#: Relative to the energy's scale: what counts as no gap where the energy is zero.
_ZERO_GAP = 1e-9
#: Most matches for which the tight relaxation is tried.
_MOST_MATCHES = 5_000
#: Most steps of the tight relaxation's splitting; time usually ends it before.
_MAX_STEPS = 10_000


class ChiralitySearch:
    """The cells that may still hold a better pose, and the best pose so far.

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
        self._zero_gap = _ZERO_GAP * energy_scale(problem)
        self._root_bound = 0.0 if (problem.constant_cost >= 0).all() else -np.inf
        self._settled_bound = np.inf
        self._evaluate = BallBounds(problem)
        self._cells = Cells.whole(problem.dim)
        self._bounds = np.full(len(self._cells), self._root_bound)

    @property
    def bound(self) -> float:
        """The lower bound of this chirality: the least of all cells, or of the relaxation if that is higher."""
        return max(self._root_bound, min(self._settled_bound, self._bounds.min(initial=np.inf)))

    def threshold(self, best: float) -> float:
        """Return the bound at which a cell is settled if ``best`` is the energy to beat.

        It lies below this chirality's own best energy by the tolerance, but need not exceed the other's: beyond that
        the mirror decision is proven.
        """
        return min(self.energy * (1.0 - self._tol) - self._zero_gap, best + self._zero_gap)

    def is_done(self, best: float) -> bool:
        """Whether nothing here can beat the energy ``best`` by more than the tolerance."""
        return self.bound >= self.threshold(best)

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
        per_cell = self.problem.num_target * self.problem.num_source * 2 ** self._cells.centres.shape[1]
        batch = max(1, _BATCH_ENTRIES // per_cell)
        self._settle(min(best, self.energy))
        while not self.is_done(min(best, self.energy)) and len(self._cells) and time.monotonic() < deadline:
            self._split(batch, min(best, self.energy))
            self._settle(min(best, self.energy))

    def use_relaxation(self, deadline: float, best: float) -> None:
        """Bound all rotations by the tight relaxation, and forget the matches that it rules out.

        Larger problems go without: there it takes longer than the cells.
        """
        if self.problem.candidates.sum() > _MOST_MATCHES:
            return
        lift = make_lift("tight", self.problem.dim)
        run = TightRun(problem=self.problem, lift=lift, tol=0.1 * self._tol, cutoff=best)
        run.solve(_MAX_STEPS, deadline)
        self._root_bound = max(self._root_bound, run.bound)
        if run.upper < self.energy:
            self.energy, self.rotation, self.map = run.upper, run.rotation, run.map
        self.problem = replace(self.problem, candidates=read_only(run.remaining))
        self._evaluate = BallBounds(self.problem)

    def _split(self, batch: int, best: float) -> None:
        """Replace the cells of least bound by their children."""
        chosen = (
            np.argpartition(self._bounds, batch)[:batch] if len(self._cells) > batch else np.arange(len(self._cells))
        )
        rest = np.delete(np.arange(len(self._cells)), chosen)
        children = self._cells.take(chosen).split()
        inherited = np.repeat(self._bounds[chosen], len(children) // len(chosen))
        rotations, radii = children.balls()
        bounds, energies, _ = self._evaluate(rotations, radii, self.threshold(best))
        self.num_cells += len(children)
        self.descend(rotations[np.argsort(energies, kind="stable")[:_NUM_DESCENTS]])
        self._cells = join([self._cells.take(rest), children])
        self._bounds = np.concatenate([self._bounds[rest], np.maximum(bounds, inherited)])

    def _settle(self, best: float) -> None:
        """Set aside the cells that cannot hold a better pose, or are too small to be split."""
        is_small = self._cells.halves <= _SMALLEST_HALF
        is_settled = self._bounds >= self.threshold(best)
        self.is_stuck |= bool((is_small & ~is_settled).any())
        aside = is_small | is_settled
        self._settled_bound = min(self._settled_bound, self._bounds[aside].min(initial=np.inf))
        self._cells, self._bounds = self._cells.take(np.flatnonzero(~aside)), self._bounds[~aside]
