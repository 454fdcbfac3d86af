"""The search of rotations and shifts for points of which some may stay unmatched, of one chirality.

Shifts are not searched as such: a pose that is better than the best one known matches some point well. Let E be the
best energy known and c what an unmatched point costs. With u points unmatched, any s of the source points contain at
least s - u matched ones, which share at most E - c u, so one of them comes to lie within

    reach^2 = max over u of (E - c u) / (s - u)

of a target point. So for each of these s points, the *anchors*, and each target point, the rotations are searched
with the anchor's image in a ball of that radius, which is split as well where rotations alone decide nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from pairwise.branch_and_bound.cells import MAX_DEPTH, Cells, join
from pairwise.branch_and_bound.motion_bounds import MotionBounds, MotionCells
from pairwise.local.freedom import Freedom
from pairwise.local.local_search import LocalMinima, minimise
from pairwise.local.rotation_sets import rotation_set
from pairwise.problem.chirality import mirror
from pairwise.problem.problem import Problem, energy_scale
from pairwise.results import Candidate

#: Rotations that are tried first with every shift that puts a point onto another, and the poses sought from.
_NUM_SCREENED, _NUM_STARTS = 512, 200
#: Centres of cells from which every batch seeks a better pose, at most.
_NUM_DESCENTS = 3
#: Cells that are bounded at once.
_MOST_AT_ONCE = 8192
#: Relative to the energy's scale: what counts as no gap where the energy is zero.
_ZERO_GAP = 1e-9
_SHIFTED = Freedom(translate=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Open:
    """Cells of one anchor that may still hold a better pose: rotations, and cubes of offsets of its image."""

    cells: Cells
    offsets: FloatArray
    halves: FloatArray
    potentials: FloatArray
    bounds: FloatArray

    def __len__(self) -> int:
        return len(self.bounds)

    def take(self, index: IntArray) -> _Open:
        return _Open(
            cells=self.cells.take(index),
            offsets=self.offsets[index],
            halves=self.halves[index],
            potentials=self.potentials[index],
            bounds=self.bounds[index],
        )


class MotionSearch:
    """The search of one chirality."""

    def __init__(self, problem: Problem, *, reflected: bool, tol: float) -> None:
        self.problem = problem
        self.reflected = reflected
        self.signs = mirror(problem.dim) if reflected else np.ones(problem.dim)
        self.bound = 0.0
        self.num_cells = 0
        self.is_done = self.is_stuck = False
        self._tol = tol
        self._zero_gap = _ZERO_GAP * energy_scale(problem)

    def start(self, candidates: Sequence[Candidate]) -> None:
        """Descend from the most promising of many rotations with shifts, and from known poses."""
        problem = self.problem
        turns, shifts = self._screened()
        if candidates:
            known = np.stack([c.R_target_source * self.signs for c in candidates])
            moved = [np.zeros(3) if c.translation is None else c.translation for c in candidates]
            turns, shifts = np.concatenate([known, turns]), np.concatenate([moved, shifts])
        self.best: LocalMinima = minimise(problem, turns, freedom=_SHIFTED, shifts=shifts)

    def _screened(self) -> tuple[FloatArray, FloatArray]:
        """Return the rotations of an even set, with shifts that put a point onto another, of the least costs."""
        problem, turns = self.problem, rotation_set(3, _NUM_SCREENED)
        evaluate = MotionBounds(problem, np.zeros(3), problem.max_unmatched)
        costs, shifts, still = [], [], np.zeros(problem.num_source * problem.num_target)
        for turn in turns:
            moved = problem.source @ turn.T
            tried = (problem.target[:, None] - moved).reshape(-1, 3)
            same = np.tile(turn, (len(tried), 1, 1))
            costs.append(evaluate.reach(MotionCells(rotations=same, angles=still, shifts=tried, reaches=still)))
            shifts.append(tried)
        best = np.argsort(np.concatenate(costs), kind="stable")[:_NUM_STARTS]
        return turns[best // len(still)], np.concatenate(shifts)[best]

    def _threshold(self, other: float) -> float:
        """Return the bound at which a cell is settled."""
        energy = min(float(self.best.energies[0]), other)
        return energy * (1.0 - self._tol) - self._zero_gap

    def run(self, deadline: float, other: float) -> None:
        """Search all anchors; ``other`` is the best energy of either chirality."""
        settled = math.inf
        for anchor in self._anchors(other):
            for place in range(self.problem.num_target):
                if self.problem.allowed[place, anchor]:
                    settled = min(settled, self._search(int(anchor), place, deadline, other))
                if time.monotonic() > deadline:
                    return
        self.bound, self.is_done = settled, True

    def _anchors(self, other: float) -> IntArray:
        """Return so many source points, the innermost ones, that the search of all is about the shortest."""
        source = self.problem.source
        order = np.argsort(np.linalg.norm(source - source.mean(axis=0), axis=1), kind="stable")
        reaches = np.array([self._reach(num, other) for num in range(1, len(source) + 1)])
        spread = float(np.sqrt(((source - source.mean(axis=0)) ** 2).sum(axis=1).mean()))
        work = np.arange(1, len(source) + 1) * (1.0 + reaches / (0.1 * spread + 1e-300)) ** 3
        self._num_anchors = int(np.argmin(work)) + 1
        return order[: self._num_anchors]

    def _reach(self, num: int, other: float) -> float:
        """Return the radius in which some of so many anchors must lie; infinite where all may be unmatched."""
        cost, most = self.problem.unmatched_cost, self._most_unmatched(other)
        energy = min(float(self.best.energies[0]), other)
        if num <= most:
            return math.inf
        unmatched = np.arange(most + 1)
        return float(np.sqrt(((energy - cost * unmatched) / (num - unmatched)).max()))

    def _most_unmatched(self, other: float) -> int:
        """Return how many points a pose leaves out at most that is better than the best one."""
        problem, energy = self.problem, min(float(self.best.energies[0]), other)
        if problem.unmatched_cost <= 0:
            return problem.max_unmatched
        return min(problem.max_unmatched, int(energy / problem.unmatched_cost), problem.num_source - 1)

    def _search(self, anchor: int, place: int, deadline: float, other: float) -> float:
        """Search the poses that put an anchor near a target point; return the least bound of what was settled."""
        evaluate = MotionBounds(self.problem, self.problem.source[anchor], self._most_unmatched(other))
        reach = self._reach(self._num_anchors, other) * (1.0 + 1e-9) + 1e-12
        whole, settled = Cells.whole(3), math.inf
        found = _Open(
            cells=whole,
            offsets=np.zeros((len(whole), 3)),
            halves=np.full(len(whole), reach),
            potentials=np.zeros((len(whole), evaluate.num_columns)),
            bounds=np.zeros(len(whole)),
        )
        while len(found):
            parts = []
            for first in range(0, len(found), _MOST_AT_ONCE):
                if time.monotonic() > deadline:
                    return 0.0
                part = found.take(np.arange(first, min(first + _MOST_AT_ONCE, len(found))))
                children, least = self._split(part, evaluate, place, reach, other)
                settled = min(settled, least)
                parts.append(children)
            found = _joined(parts)
            small = found.cells.depths >= MAX_DEPTH
            if small.any():
                self.is_stuck, settled = True, min(settled, float(found.bounds[small].min()))
                found = found.take(np.flatnonzero(~small))
        return settled

    def _split(
        self, part: _Open, evaluate: MotionBounds, place: int, reach: float, other: float
    ) -> tuple[_Open, float]:
        """Split cells and bound the children; return those that are left, and the least bound of the others."""
        angles = part.cells.balls()[1]
        reaches = np.minimum(math.sqrt(3.0) * part.halves, reach)
        turns = 2.0 * np.sin(0.5 * np.minimum(angles, np.pi)) * evaluate.lever >= reaches
        children = _joined([_halved(part.take(np.flatnonzero(turns))), _octants(part.take(np.flatnonzero(~turns)))])
        rotations, angles = children.cells.balls()
        cells = MotionCells(
            rotations=rotations,
            angles=angles,
            shifts=self.problem.target[place] + children.offsets,
            reaches=np.minimum(math.sqrt(3.0) * children.halves, reach),
        )
        self.num_cells += len(children)
        threshold = self._threshold(other)
        bounds = np.maximum(children.bounds, evaluate.reach(cells))
        open_ = bounds < threshold
        settled = float(bounds[~open_].min(initial=math.inf))
        quasi, energies, potentials = evaluate.quasi(cells.take(open_), threshold, children.potentials[open_])
        self._improve(cells.take(open_), energies, evaluate)
        bounds = np.maximum(bounds[open_], quasi)
        left = bounds < threshold
        settled = min(settled, float(bounds[~left].min(initial=math.inf)))
        kept = children.take(np.flatnonzero(open_)[left])
        return (
            _Open(
                cells=kept.cells,
                offsets=kept.offsets,
                halves=kept.halves,
                potentials=potentials[left],
                bounds=bounds[left],
            ),
            settled,
        )

    def _improve(self, cells: MotionCells, energies: FloatArray, evaluate: MotionBounds) -> None:
        """Descend from the best centres where they look better than the best pose."""
        best = np.argsort(energies, kind="stable")[:_NUM_DESCENTS]
        best = best[energies[best] < self.best.energies[0]]
        if not len(best):
            return
        origin = self.problem.source[0] - evaluate.source[0]
        shifts = cells.shifts[best] - cells.rotations[best] @ origin
        found = minimise(self.problem, cells.rotations[best], freedom=_SHIFTED, shifts=shifts)
        if found.energies[0] < self.best.energies[0]:
            self.best = found


def _halved(part: _Open) -> _Open:
    """Halve the rotations of each cell."""
    return _Open(
        cells=part.cells.split(),
        offsets=np.repeat(part.offsets, 2, axis=0),
        halves=np.repeat(part.halves, 2),
        potentials=np.repeat(part.potentials, 2, axis=0),
        bounds=np.repeat(part.bounds, 2),
    )


def _octants(part: _Open) -> _Open:
    """Split the cube of offsets of each cell into eight."""
    signs = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    offsets = part.offsets[:, None] + 0.5 * part.halves[:, None, None] * signs
    return _Open(
        cells=part.cells.take(np.repeat(np.arange(len(part)), 8)),
        offsets=offsets.reshape(-1, 3),
        halves=np.repeat(0.5 * part.halves, 8),
        potentials=np.repeat(part.potentials, 8, axis=0),
        bounds=np.repeat(part.bounds, 8),
    )


def _joined(parts: list[_Open]) -> _Open:
    return _Open(
        cells=join([part.cells for part in parts]),
        offsets=np.concatenate([part.offsets for part in parts]),
        halves=np.concatenate([part.halves for part in parts]),
        potentials=np.concatenate([part.potentials for part in parts]),
        bounds=np.concatenate([part.bounds for part in parts]),
    )
