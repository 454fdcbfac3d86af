"""Rounding: the four starts of appendix A with the right signs, and draws that keep several poses apart."""

import numpy as np

from data_tools.rotations import rotation_angles
from pairwise.local_search import minimise
from pairwise.pm_sdp.rounding import draw_rotations, nearest_map, rank_one_factors
from pairwise.problem import Problem
from pairwise.results import RelaxationResult, Status
from pairwise.rotation_sets import random_rotations


def mixture(problem, rotations, maps, sign=1.0):
    """The relaxation's variables of equally likely exact poses; ``sign`` is a fault to be seen."""
    n, k, m = problem.num_target, problem.num_source, len(rotations)
    packed = problem.pattern.pack(rotations)
    x, b = np.zeros((n, k)), np.zeros((k, packed.shape[1], n))
    for entries, point_map in zip(packed, maps, strict=True):
        x[point_map, np.arange(k)] += 1 / m
        b[np.arange(k), :, point_map] += sign * entries / m
    return RelaxationResult(
        value=0.0,
        lower_bound=0.0,
        R=problem.pattern.unpack(packed.mean(axis=0)),
        X=x,
        C=packed.T @ packed / m,
        B=b,
        status=Status.CONVERGED,
    )


def planted_pose(rng, dim=3, num=10):
    points = rng.random((num, dim)) - 0.5
    turn, point_map = random_rotations(dim, 1, rng)[0], rng.permutation(num)
    return Problem.from_user(points, points[point_map] @ turn), turn, point_map


def test_the_sign_of_the_rank_one_factors_is_that_of_probabilities(rng):
    problem, turn, point_map = planted_pose(rng)
    exact = mixture(problem, turn[None], point_map[None])
    entries, probabilities = rank_one_factors(exact)
    np.testing.assert_allclose(np.einsum("r,nk->krn", entries, probabilities), exact.B, atol=1e-9)
    assert probabilities.sum() > 0
    np.testing.assert_array_equal(nearest_map(problem, probabilities), point_map)
    np.testing.assert_allclose(
        problem.pattern.project(problem.pattern.unpack(entries)), turn, atol=1e-9
    )
    flipped, _ = rank_one_factors(mixture(problem, turn[None], point_map[None], sign=-1.0))
    assert entries @ flipped < 0


def test_draws_find_both_poses_where_one_rounding_finds_none(rng):
    half = rng.random((4, 3)) - 0.5
    points = np.concatenate([half, half * [-1.0, -1.0, 1.0]])
    problem = Problem.from_user(points, points)
    turns = np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])])
    maps = np.stack([np.arange(8), np.r_[4:8, 0:4]])
    mixed = mixture(problem, turns, maps)
    drawn = problem.pattern.project(draw_rotations(problem, mixed, 20, np.random.default_rng(0)))
    assert drawn.shape == (20, 3, 3)
    for turn in turns:
        assert rotation_angles(drawn, turn).min() < 1e-6
    found = minimise(problem, drawn)
    np.testing.assert_allclose(found.energies[:2], 0.0, atol=1e-12)


def test_the_nearest_map_keeps_to_the_candidates():
    allowed = np.array([[True, False], [True, True]])
    masked = Problem.from_user(np.zeros((2, 3)), np.zeros((2, 3)), allowed=allowed)
    np.testing.assert_array_equal(nearest_map(masked, np.array([[0.0, 9.0], [1.0, 0.0]])), [0, 1])
