"""PM-SDP in CVXPY against brute force and invariances."""

import math
from dataclasses import replace

import pytest

from pairwise.pm_sdp.cvxpy_model import build_model
from pairwise.pm_sdp.cvxpy_solve import solve_model
from pairwise.problem import Problem
from pairwise.relaxations import SOLVERS, solve_pm_sdp
from pairwise.results import Status
from tests.oracles import brute_force, check_relaxation
from tests.problems import catalogue, random_rotation

CATALOGUE = catalogue()


def value_of(problem, solver="clarabel", tol=1e-8):
    return solve_pm_sdp(problem, solver=solver, tol=tol).value


@pytest.mark.parametrize("known", CATALOGUE, ids=lambda known: known.name)
def test_solution_is_feasible_and_bounds_the_optimum(known):
    model = build_model(known.problem)
    result = solve_model(model, solver="clarabel", tol=1e-8, max_iterations=SOLVERS["clarabel"][1])
    assert result.status in (Status.CONVERGED, Status.STALLED)
    assert check_relaxation(known.problem, result, 1e-5) == []
    assert math.isnan(result.lower_bound)
    optimum = brute_force(known.problem).energy if math.isnan(known.optimum) else known.optimum
    assert result.value <= optimum + 1e-5 * (1.0 + optimum)
    if known.num_solutions != 0:
        assert result.value == pytest.approx(0.0, abs=1e-5)


def test_value_does_not_depend_on_pose_labels_or_solver(rng):
    target, source, weights = rng.random((5, 3)), rng.random((4, 3)), rng.random(4) + 0.1
    value = value_of(Problem.from_user(target, source, weights=weights))
    shuffle, order = rng.permutation(5), rng.permutation(4)
    moved = Problem.from_user(
        target[shuffle] @ random_rotation(rng, 3),
        source[order] @ random_rotation(rng, 3),
        weights=weights[order],
    )
    assert value_of(moved) == pytest.approx(value, abs=1e-6)
    assert value_of(moved, "scs", 1e-7) == pytest.approx(value, abs=1e-5)
    mirrored = replace(moved, source=moved.source * [-1.0, 1.0, 1.0])
    assert abs(value_of(mirrored) - value) > 1e-4
