"""The full lifted relaxation has the value of PM-SDP: the claim of chordality, checked on every variant."""

import pytest

from experiments.figures.full_lifted import solve_full_lifted
from pairwise.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from tests.oracles import check_relaxation


@pytest.mark.parametrize(
    ("num_target", "num_source", "dim", "options", "equations"),
    [
        (4, 4, 3, {}, {}),
        (4, 4, 3, {}, {"cross_products": True}),
        (5, 3, 3, {}, {}),
        (4, 4, 3, {"group": "O"}, {"row_sums": True}),
        (4, 4, 2, {}, {"cross_products": True}),
        (4, 3, 4, {"rotation_pattern": [3, 1]}, {"cross_products": True}),
        (4, 4, 4, {"rotation_pattern": 1, "group": "O"}, {"row_sums": True}),
    ],
)
def test_value_equals_pm_sdp(num_target, num_source, dim, options, equations, rng):
    target, source = rng.random((num_target, dim)), rng.random((num_source, dim))
    problem = Problem.from_user(target, source, **options)
    equations = {"cross_products": False, "row_sums": False} | equations
    pm_sdp = solve_pm_sdp(problem, solver="clarabel", tol=1e-8, **equations)
    full = solve_full_lifted(problem, tol=1e-8, **equations)
    assert full.value == pytest.approx(pm_sdp.value, abs=2e-6)
    assert check_relaxation(problem, full, 1e-5) == []
