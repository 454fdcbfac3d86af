"""One solve of the tight relaxation over SO(2) or SO(3): splitting, bounds, dropped matches, best pose found."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from data_tools.arrays import BoolArray, FloatArray
from pairwise.local.local_search import minimise
from pairwise.local.rotation_sets import rotation_set
from pairwise.problem.problem import Problem
from pairwise.status import Status
from pairwise.tight.dual import DualStage, single_map_stage, stage_of
from pairwise.tight.lift import Lift, make_lift
from pairwise.tight.problem import energy_scale, lift_problem, penalty
from pairwise.tight.splitting import Splitting

#: Steps of the splitting between two looks at the bound.
STEPS_PER_CHECK = 25
#: Rotations from which the upper bound is sought at the start.
NUM_STARTS = 64
#: Matches are dropped once at least this share of them can be.
_LEAST_DROP = 0.1
#: How much dearer than the best pose, relative to the energy's scale, a match must be to be dropped.
_DROP_MARGIN = 1e-9


@dataclass(kw_only=True, eq=False)
class TightRun:
    """State of the method and, at its end, its answer.

    Each certified bound is compared with the energy of a pose found by local minimisation; matches that provably
    belong to no optimal solution are dropped (reduced-cost fixing), and where one map is left Procrustes finishes
    exactly.

    Attributes
    ----------
    problem : Problem
        Over SO(2) or SO(3).
    lift : Lift
    tol : float
        Relative gap between value and bound at which to stop.
    eliminate : bool
        Whether to drop matches.
    cutoff : float
        An energy known from elsewhere (the other chirality): stop as soon as the bound exceeds it.
    proof : tuple of DualStage
        What proves ``bound``: the last stage its own, every earlier one that the matches which the next one lacks
        cost at least that.
    bound, value, upper : float
        The lower bound, the relaxation's value (that of the splitting, moved between the other two where it is not),
        and the energy of the best pose found.
    rotation, map : ndarray, shapes (d, d) and (k,)
        The best pose found.
    is_settled : bool
        Whether the best map is proven to be the only one left.
    """

    problem: Problem
    lift: Lift
    tol: float
    eliminate: bool = True
    cutoff: float = np.inf
    proof: tuple[DualStage, ...] = ()
    bound: float = -np.inf
    value: float = np.nan
    upper: float = np.inf
    iterations: int = 0
    is_settled: bool = False
    status: Status = Status.ITERATION_LIMIT
    _stages: list[DualStage] = field(default_factory=list)
    _floor: float = np.inf

    def __post_init__(self) -> None:
        started = time.monotonic()
        self.scale = energy_scale(self.problem)
        self._descend(rotation_set(self.problem.dim, NUM_STARTS))
        blocks = lift_problem(self.problem, self.lift, self.problem.allowed)
        start = np.zeros((len(blocks.rows), self.lift.size, self.lift.size))
        self.splitting = Splitting(lift=self.lift, blocks=blocks, rho=penalty(blocks, self.lift), v=start)
        self.setup_s = time.monotonic() - started

    def solve(self, max_iterations: int, deadline: float) -> TightRun:
        """Iterate until converged, proven, or out of steps or time (``time.monotonic()`` past ``deadline``)."""
        started = time.monotonic()
        while self.iterations < max_iterations:
            steps = min(STEPS_PER_CHECK, max_iterations - self.iterations)
            self.splitting.run(steps)
            self.iterations += steps
            stage = stage_of(self.splitting, self.problem.num_source)
            self._record(stage)
            self._descend(self._rounding())
            estimate = float((self.splitting.x * self.splitting.blocks.costs).sum())
            self.value = min(max(estimate, self.bound), self.upper)
            if self._has_ended(estimate) or (self.eliminate and self._drop(stage)):
                self.status = Status.CONVERGED
                break
            if time.monotonic() > deadline:
                self.status = Status.TIME_LIMIT
                break
        self.solve_s = time.monotonic() - started
        return self

    @property
    def gap_tol(self) -> float:
        """The gap that counts as none, in the energy's unit."""
        return self.tol * max(self.upper, 1e-3 * self.scale)

    @property
    def remaining(self) -> BoolArray:
        """The matches that may belong to a solution no dearer than the best pose or the cutoff, shape (n, k)."""
        if self.is_settled:
            return np.arange(self.problem.num_target)[:, None] == self.map
        blocks = self.splitting.blocks
        remaining = np.zeros(self.problem.allowed.shape, dtype=bool)
        matches = blocks.cols < self.problem.num_source
        remaining[blocks.rows[matches], blocks.cols[matches]] = True
        return remaining

    def mean_block(self) -> FloatArray:
        """Return M, the lifted rotation's moments, shape (s, s)."""
        if self.is_settled:
            z = self.lift.vectors(self.rotation)
            return np.outer(z, z)
        return (self.lift.flat_basis @ self.splitting.mean).reshape(self.lift.size, self.lift.size)

    def _record(self, stage: DualStage) -> None:
        """Keep the stage if, after those before it, it proves more than what was known."""
        bound = min(stage.bound, self._floor)
        if bound > self.bound:
            self.bound, self.proof = bound, (*self._stages, stage)

    def _has_ended(self, estimate: float) -> bool:
        """Whether the bound meets the splitting's value or the best energy, and the blocks fit their sums."""
        if self.bound > self.cutoff:
            return True
        gap = min(abs(estimate - self.bound), abs(self.upper - self.bound))
        return gap <= self.gap_tol and self.splitting.residual <= max(self.tol, 1e-5)

    def _rounding(self) -> FloatArray:
        return self.problem.pattern.project(self.lift.mean_rotations(self.mean_block()))[None]

    def _descend(self, rotations: FloatArray) -> None:
        best = minimise(self.problem, rotations)
        if best.energies[0] < self.upper:
            self.upper, self.rotation, self.map = float(best.energies[0]), best.rotations[0], best.maps[0]

    def _drop(self, stage: DualStage) -> bool:
        """Drop the matches that are too dear for any optimal solution; return whether that settles the problem."""
        limit = min(self.upper, self.cutoff) + _DROP_MARGIN * self.scale
        kept = stage.allowed & (stage.forced <= limit)
        dropped = stage.allowed & ~kept
        is_single = bool((kept.sum(axis=0) == 1).all())
        if not kept.any(axis=0).all() or not dropped.any():
            return False
        if dropped.sum() < _LEAST_DROP * stage.allowed.sum() and not is_single:
            return False
        self._stages.append(stage)
        self._floor = min(self._floor, float(stage.forced[dropped].min()))
        if is_single:
            self._settle(kept)
            return True
        old = self.splitting
        remains = np.append(kept, np.ones((len(kept), 1), dtype=bool), axis=1)[old.blocks.rows, old.blocks.cols]
        self.splitting = Splitting(lift=self.lift, blocks=old.blocks.subset(remains), rho=old.rho, v=old.v[remains])
        return False

    def _settle(self, kept: BoolArray) -> None:
        """Finish with the only map left, in closed form."""
        lift = make_lift("quaternion", self.problem.dim)
        blocks = lift_problem(self.problem, lift, kept)
        self._record(single_map_stage(lift, blocks, self.problem.num_source))
        self._descend(self.problem.procrustes(kept.argmax(axis=0))[None])
        self.is_settled = bool(kept[self.map, np.arange(len(self.map))].all())
        self.value = self.upper if self.is_settled else self.bound
