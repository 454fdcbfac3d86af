"""PM-SDP in CVXPY against brute force."""

import math

import pytest

from pairwise.pm_sdp.cvxpy_model import build_model
from pairwise.pm_sdp.cvxpy_solve import solve_model
from pairwise.relaxations import SOLVERS
from pairwise.results import Status
from tests.oracles import brute_force, check_relaxation
from tests.problems import catalogue

#: Few points: CVXPY compiles each problem.
CATALOGUE = [known for known in catalogue() if known.problem.num_target < 6]


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
