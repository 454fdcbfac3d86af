"""Screening: lower bounds are below the assignment's cost, and ICP steps go where exact steps go."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from data_tools.rotations import rotation_angles
from pairwise.local.rotation_sets import random_rotations
from pairwise.local.screening import NearestCosts, screen
from pairwise.problem.problem import Problem
from tests.problems import catalogue, planted


def exact_cost(problem: Problem, rotation: np.ndarray) -> float:
    cost = problem.assignment_costs(rotation).T
    return float(cost[linear_sum_assignment(cost)].sum())


@pytest.mark.parametrize("known", catalogue(), ids=lambda known: known.name)
def test_lower_bounds_are_below_the_exact_cost(known) -> None:
    problem = known.problem
    rotations = problem.pattern.project(random_rotations(problem.dim, 6, np.random.default_rng(1)))
    bounds = NearestCosts(problem).lower_bounds(rotations)
    for rotation, bound in zip(rotations, bounds, strict=True):
        exact = exact_cost(problem, rotation)
        assert bound <= exact + 1e-5 * (1.0 + exact)


def test_the_planted_pose_stays_and_comes_first(rng: np.random.Generator) -> None:
    points = rng.random((30, 3)) - 0.5
    turn = random_rotations(3, 1, rng)[0]
    problem = Problem.from_user(points, points @ turn)
    rotations, bounds = screen(problem, np.concatenate([random_rotations(3, 40, rng), turn[None]]), num_steps=1)
    assert rotation_angles(rotations[0], turn) < 1e-3
    assert (np.diff(bounds) >= 0).all()


@pytest.mark.parametrize("unit", [1e-30, 1e30])
def test_extreme_units_do_not_matter(rng: np.random.Generator, unit: float) -> None:
    target, source, rotations = rng.random((12, 3)), rng.random((12, 3)), random_rotations(3, 5, rng)
    weights = rng.random(12)
    usual, bounds = screen(Problem.from_user(target, source, weights=weights), rotations)
    other, scaled = screen(Problem.from_user(unit * target, unit * source, weights=1e25 * weights), rotations)
    np.testing.assert_allclose(other, usual, atol=1e-5)
    np.testing.assert_allclose(scaled, bounds * unit**2 * 1e25, rtol=1e-4)


def test_batches_do_not_change_the_answer(rng: np.random.Generator) -> None:
    problem = planted(rng, rng.random((12, 3)), noise=0.1)
    rotations = random_rotations(3, 9, rng)
    whole, single = NearestCosts(problem), NearestCosts(problem)
    single.chunk = 2
    np.testing.assert_allclose(whole.step(rotations), single.step(rotations), atol=1e-5)
