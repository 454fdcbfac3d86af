"""The full lifted relaxation has the value of PM-SDP: the claim of chordality, checked on every variant."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.figures.full_lifted import solve_full_lifted
from pairwise.problem.problem import Problem
from pairwise.reference.pm_sdp import solve_reference
from tests.oracles import check_relaxation


@pytest.mark.parametrize(
    ("num_target", "num_source", "dim", "options"),
    [
        (4, 4, 3, {}),
        (5, 3, 3, {}),
        (4, 4, 3, {"group": "O"}),
        (4, 4, 2, {}),
        (4, 3, 4, {"rotation_pattern": [3, 1]}),
        (4, 4, 4, {"rotation_pattern": 1, "group": "O"}),
    ],
)
def test_value_equals_pm_sdp(
    num_target: int, num_source: int, dim: int, options: dict[str, object], rng: np.random.Generator
) -> None:
    target, source = rng.random((num_target, dim)), rng.random((num_source, dim))
    problem = Problem.from_user(target, source, **options)
    for cross_products in (False, True):
        pm_sdp = solve_reference(problem, tol=1e-8, cross_products=cross_products)
        full = solve_full_lifted(problem, tol=1e-8, cross_products=cross_products)
        assert full.value == pytest.approx(pm_sdp.value, abs=2e-6)
        assert check_relaxation(problem, full, 1e-5) == []


def test_equal_value_with_masks_and_weights(rng: np.random.Generator) -> None:
    mask = np.ones((4, 4), bool)
    mask[[0, 2], [1, 3]] = False
    problem = Problem.from_user(rng.random((4, 3)), rng.random((4, 3)), allowed=mask, weights=rng.random(4) + 0.1)
    free = Problem.from_user(problem.target, problem.source)
    full = solve_full_lifted(problem, tol=1e-8).value
    assert full == pytest.approx(solve_reference(problem, tol=1e-8).value, abs=2e-6)
    assert abs(full - solve_full_lifted(free, tol=1e-8).value) > 1e-4
