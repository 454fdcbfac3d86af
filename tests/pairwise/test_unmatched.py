"""Matching with unmatched points: the energy by definition, brute force, bounds, outliers, and shifts."""

import itertools
import math

import numpy as np
import pytest

from data_tools.errors import OptionsError
from data_tools.rotations import rotation_angle_deg
from pairwise import Problem, match, prove, verify_certificate, with_unmatched
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import Status
from pairwise.rotation_sets import random_rotations


def least_truncated_energy(problem, cost):
    """The least energy over every injective map of every subset of the source points, by definition."""
    n, k = problem.num_target, problem.num_source
    best = math.inf
    for kept in itertools.chain.from_iterable(
        itertools.combinations(range(k), m) for m in range(k + 1)
    ):
        for images in itertools.permutations(range(n), len(kept)):
            source, target = problem.source[list(kept)], problem.target[list(images)]
            weights = problem.weights[list(kept)]
            turn = problem.pattern.project(target.T @ (weights[:, None] * source))
            squares = ((source @ turn.T - target) ** 2).sum(axis=1)
            free = cost * (problem.weights.sum() - weights.sum())
            best = min(best, float(weights @ squares) + free)
    return best


def with_outliers(seed, *, num=30, share=0.3, noise=0.02, shift=0.0):
    rng = np.random.default_rng(seed)
    num_out = round(share * num)
    base, turn = rng.standard_normal((num - num_out, 3)), random_rotations(3, 1, rng)[0]
    target = np.vstack([base, 1.5 * rng.standard_normal((num_out, 3))])
    source = np.vstack(
        [base + noise * rng.standard_normal(base.shape), 1.5 * rng.standard_normal((num_out, 3))]
    )
    order = rng.permutation(num)
    expected = np.where(order < len(base), order, -1)
    return target, (source @ turn)[order] + shift, turn, expected


@pytest.mark.parametrize(
    ("seed", "cost"), [(1, 0.05), (0, 0.2), (1, 0.2), (2, 0.2), (0, 2.0), (2, 2.0)]
)
def test_bounds_are_below_the_least_energy_by_definition_and_poses_reach_it(seed, cost):
    rng = np.random.default_rng(seed)
    problem = Problem.from_user(rng.random((4, 3)), rng.random((4, 3)), weights=rng.random(4) + 0.5)
    optimum, robust = least_truncated_energy(problem, cost), with_unmatched(problem, cost)
    proof = prove(robust, record=True)
    assert proof.status is Status.PROVEN_OPTIMAL
    assert proof.candidate.energy == pytest.approx(optimum, rel=1e-6)
    assert proof.lower_bound <= optimum * (1 + 1e-9)
    relaxed = solve_pm_sdp(robust)
    assert relaxed.lower_bound <= optimum * (1 + 1e-9)
    for certificate in (proof.certificate, relaxed.certificate):
        assert verify_certificate(
            robust.target, robust.source, certificate, problem=robust
        ) <= optimum * (1 + 1e-9)
    found = match(
        problem.target, problem.source, weights=problem.weights, unmatched_cost=cost, certify=True
    )
    assert found.energy == pytest.approx(optimum, rel=1e-3)
    assert 0.0 <= found.lower_bound <= optimum * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_outliers_are_left_unmatched_where_matching_all_points_fails(seed):
    target, source, turn, expected = with_outliers(seed)
    found = match(target, source, unmatched_cost=0.08**2)
    assert rotation_angle_deg(found.R_target_source, turn) < 1.0
    np.testing.assert_array_equal(found.map_target_source, expected)
    assert found.energy < 9 * 0.08**2 + 0.1
    assert rotation_angle_deg(match(target, source).R_target_source, turn) > 10.0


def test_sets_are_shifted_to_what_matches():
    target, source, turn, expected = with_outliers(1, shift=np.array([0.3, -0.2, 0.1]))
    found = match(target, source, unmatched_cost=0.08**2, translation=True)
    assert rotation_angle_deg(found.R_target_source, turn) < 1.0
    np.testing.assert_array_equal(found.map_target_source, expected)
    matched = expected >= 0
    moved = source[matched] @ found.R_target_source.T + found.translation
    assert np.sqrt(((moved - target[expected[matched]]) ** 2).sum(axis=1).mean()) < 0.08


@pytest.mark.parametrize("cost", [0.0, -1.0, math.nan, math.inf])
def test_impossible_costs_are_refused(cost):
    with pytest.raises(OptionsError, match="unmatched_cost"):
        match(np.eye(3), np.eye(3), unmatched_cost=cost)
