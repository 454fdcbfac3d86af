"""Dropping matches: what is left, and what a bound is worth once something was left out."""

from __future__ import annotations

import numpy as np

from pairwise.problem.problem import Problem
from pairwise.tight.dual import DualStage
from pairwise.tight.lift import make_lift
from pairwise.tight.problem import chiralities
from pairwise.tight.run import TightRun
from tests.tight_problems import planted_cube


def started(cutoff: float) -> TightRun:
    """A run on eight points whose best energy is known to be above ``cutoff``."""
    _, problem = chiralities(Problem.from_user(*planted_cube(8, 0.3, 1)))[0]
    return TightRun(problem=problem, lift=make_lift("quaternion", 3), tol=1e-3, cutoff=cutoff)


def stage_with(run: TightRun, bound: float, forced: np.ndarray) -> DualStage:
    none = np.zeros((0, 0))
    return DualStage(
        lift=run.lift,
        allowed=run.remaining,
        target_multipliers=none,
        source_multipliers=none,
        identity_multipliers=none,
        bound=bound,
        forced=forced,
    )


def test_matches_are_dropped_only_above_the_limit() -> None:
    run = started(cutoff=np.inf)
    forced = np.full((8, 8), 0.9 * run.upper)
    forced[:4, 4:] = 2.0 * run.upper
    run._drop(stage_with(run, 0.1, forced))
    assert np.array_equal(run.remaining, forced < run.upper)


def test_a_bound_is_worth_no_more_than_the_cheapest_match_that_was_dropped() -> None:
    run = started(cutoff=1e-3)
    assert run.upper > 0.1
    forced = np.zeros((8, 8))
    forced[:4, 4:], forced[0, 5] = 0.05, 0.02
    run._drop(stage_with(run, 0.0, forced))
    run._record(stage_with(run, 0.08, np.zeros((8, 8))))
    assert run.bound == 0.02
    again = np.where(run.remaining, 0.0, np.inf)
    again[4:, :4] = 0.03
    run._drop(stage_with(run, 0.0, again))
    run._record(stage_with(run, 0.08, np.zeros((8, 8))))
    assert run.bound == 0.02
