"""PM-SDP in CVXPY against brute force, invariances, and refusals."""

import math
from dataclasses import replace

import pytest

from data_tools.errors import OptionsError
from experiments.reference.pm_sdp import solve_reference
from pairwise.problem import Problem
from pairwise.results import Status
from tests.oracles import brute_force, check_relaxation
from tests.problems import catalogue, random_rotation

CATALOGUE = catalogue()


@pytest.mark.parametrize("known", CATALOGUE, ids=lambda known: known.name)
def test_solution_is_feasible_and_bounds_the_optimum(known):
    result = solve_reference(known.problem, tol=1e-8)
    assert result.status in (Status.CONVERGED, Status.STALLED)
    assert check_relaxation(known.problem, result, 1e-5) == []
    assert math.isnan(result.lower_bound)
    optimum = brute_force(known.problem).energy if math.isnan(known.optimum) else known.optimum
    assert result.value <= optimum + 1e-5 * (1.0 + optimum)
    if known.num_solutions != 0:
        assert result.value == pytest.approx(0.0, abs=1e-5)


def test_value_does_not_depend_on_pose_labels_or_solver(rng):
    target, source, weights = rng.random((5, 3)), rng.random((4, 3)), rng.random(4) + 0.1
    value = solve_reference(Problem.from_user(target, source, weights=weights), tol=1e-8).value
    shuffle, order = rng.permutation(5), rng.permutation(4)
    moved = Problem.from_user(
        target[shuffle] @ random_rotation(rng, 3),
        source[order] @ random_rotation(rng, 3),
        weights=weights[order],
    )
    assert solve_reference(moved, tol=1e-8).value == pytest.approx(value, abs=1e-6)
    assert solve_reference(moved, tol=1e-7, solver="scs").value == pytest.approx(value, abs=1e-5)
    mirrored = replace(moved, source=moved.source * [-1.0, 1.0, 1.0])
    assert abs(solve_reference(mirrored, tol=1e-8).value - value) > 1e-4


def test_limits_are_statuses(rng):
    problem = Problem.from_user(rng.random((6, 3)), rng.random((6, 3)))
    assert (
        solve_reference(problem, solver="scs", tol=1e-9, max_iterations=50).status
        is Status.ITERATION_LIMIT
    )
    stopped = solve_reference(problem, solver="clarabel", tol=1e-9, max_iterations=3)
    assert stopped.status is Status.ITERATION_LIMIT
    late = solve_reference(problem, solver="scs", tol=1e-10, time_limit_s=0.02)
    assert late.status is Status.TIME_LIMIT


def test_wrong_options_are_refused(rng):
    problem = Problem.from_user(rng.random((3, 3)), rng.random((3, 3)))
    for options in (
        {"solver": "mosek"},
        {"tol": 0.0},
        {"max_iterations": 0},
        {"time_limit_s": -1.0},
    ):
        with pytest.raises(OptionsError, match=next(iter(options))):
            solve_reference(problem, **options)
