"""Screening: lower bounds are below the assignment's cost, and ICP steps go where exact steps go."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from data_tools.rotations import rotation_angles
from pairwise.local.freedom import Freedom
from pairwise.local.rotation_sets import random_rotations
from pairwise.local.screening import NearestCosts, screen
from pairwise.problem.problem import Problem
from tests.problems import catalogue, planted


def exact_cost(problem: Problem, rotation: np.ndarray) -> float:
    cost = problem.assignment_costs(rotation).T
    if problem.max_unmatched:
        unmatched = np.full((problem.num_source, problem.max_unmatched), problem.unmatched_cost)
        cost = np.concatenate([cost, unmatched], axis=1)
    return float(cost[linear_sum_assignment(cost)].sum())


@pytest.mark.parametrize("known", catalogue(), ids=lambda known: known.name)
def test_lower_bounds_are_below_the_exact_cost(known) -> None:
    problem = known.problem
    rotations = problem.pattern.project(random_rotations(problem.dim, 6, np.random.default_rng(1)))
    bounds = NearestCosts(problem).lower_bounds(rotations)
    for rotation, bound in zip(rotations, bounds, strict=True):
        exact = exact_cost(problem, rotation)
        assert bound <= exact + 1e-5 * (1.0 + exact)


@pytest.mark.parametrize("partial", [{"num_matches": 7}, {"unmatched_penalty": 0.01}])
def test_lower_bounds_of_partial_matching_are_below_too(rng: np.random.Generator, partial) -> None:
    problem = planted(rng, rng.random((10, 3)), noise=0.2, **partial)
    rotations = random_rotations(3, 20, rng)
    bounds = NearestCosts(problem).lower_bounds(rotations)
    exact = np.array([exact_cost(problem, rotation) for rotation in rotations])
    assert (bounds <= exact + 1e-5).all()
    assert bounds.max() > 0


def test_the_planted_pose_stays_and_comes_first(rng: np.random.Generator) -> None:
    points = rng.random((30, 3)) - 0.5
    turn = random_rotations(3, 1, rng)[0]
    problem = Problem.from_user(points, points @ turn)
    rotations, shifts, bounds = screen(
        problem, np.concatenate([random_rotations(3, 40, rng), turn[None]]), num_steps=1
    )
    assert rotation_angles(rotations[0], turn) < 1e-3
    assert (np.diff(bounds) >= 0).all()
    assert not shifts.any()


def test_shifts_are_found_on_request(rng: np.random.Generator) -> None:
    points, shift = rng.random((30, 3)), np.array([0.1, -0.05, 0.02])
    problem = Problem.from_user(points + shift, points)
    rotations, shifts, bounds = screen(problem, np.eye(3)[None], num_steps=20, freedom=Freedom(translate=True))
    np.testing.assert_allclose(shifts[0], shift, atol=1e-6)
    assert rotation_angles(rotations[0], np.eye(3)) < 1e-6
    assert bounds[0] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("unit", [1e-30, 1e30])
def test_extreme_units_do_not_matter(rng: np.random.Generator, unit: float) -> None:
    target, source, rotations = rng.random((12, 3)), rng.random((12, 3)), random_rotations(3, 5, rng)
    weights = rng.random(12)
    usual, _, bounds = screen(Problem.from_user(target, source, weights=weights), rotations)
    other, _, scaled = screen(Problem.from_user(unit * target, unit * source, weights=1e25 * weights), rotations)
    np.testing.assert_allclose(other, usual, atol=1e-5)
    np.testing.assert_allclose(scaled, bounds * unit**2 * 1e25, rtol=1e-4)


def test_batches_do_not_change_the_answer(rng: np.random.Generator) -> None:
    problem = planted(rng, rng.random((12, 3)), noise=0.1)
    rotations = random_rotations(3, 9, rng)
    whole, single = NearestCosts(problem), NearestCosts(problem)
    single.chunk = 2
    shifts = np.zeros((9, 3))
    np.testing.assert_allclose(whole.step(rotations, shifts)[0], single.step(rotations, shifts)[0], atol=1e-5)
