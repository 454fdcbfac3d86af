"""Two-way partial matching: the optimum over all subsets, planted outliers, bounds, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from data_tools.errors import InputError, OptionsError
from data_tools.rotations import rotation_angles
from pairwise import MatchOptions, match
from pairwise.local.rotation_sets import random_rotations
from pairwise.matching import match_problem
from pairwise.problem.problem import Problem
from tests.oracles import brute_force


def outliers(seed: int, *, num: int, num_wrong: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Target, source and rotation; the first ``num_wrong`` points of both have no counterpart."""
    rng = np.random.default_rng(seed)
    target = rng.random((num, 3)) - 0.5
    turn = random_rotations(3, 1, rng)[0]
    source = target + 0.005 * rng.standard_normal(target.shape)
    source[:num_wrong] = 2.0 * (rng.random((num_wrong, 3)) - 0.5)
    return target, source @ turn, turn


def test_the_oracle_sees_what_leaving_points_out_is_worth() -> None:
    target, source, _ = outliers(0, num=5, num_wrong=1)
    whole = Problem.from_user(target, source)
    partial = Problem.from_user(target, source, num_matches=4)
    assert brute_force(partial).energy < 0.1 * brute_force(whole).energy
    assert brute_force(Problem.from_user(target, source, num_matches=5)).energy == brute_force(whole).energy


@pytest.mark.parametrize("options", [{"num_matches": 4}, {"num_matches": 1}, {"unmatched_penalty": 0.02}])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_best_pose_is_the_optimum_over_subsets(seed: int, options) -> None:
    target, source, _ = outliers(seed, num=6, num_wrong=2)
    problem = Problem.from_user(target, source[1:], **options)
    result = match_problem(problem, MatchOptions())
    assert result.energy == pytest.approx(brute_force(problem).energy, rel=1e-6, abs=1e-9)
    assert problem.energy(result.R_target_source, result.map_target_source) == pytest.approx(result.energy, abs=1e-9)


@pytest.mark.parametrize("options", [{"num_matches": 15}, {"unmatched_penalty": 0.01}])
@pytest.mark.parametrize("strategy", ["search", "portfolio"])
def test_planted_outliers_stay_unmatched(options, strategy) -> None:
    target, source, turn = outliers(3, num=20, num_wrong=5)
    result = match(target, source, strategy=strategy, **options)
    np.testing.assert_array_equal(result.map_target_source, [-1] * 5 + list(range(5, 20)))
    assert np.rad2deg(rotation_angles(result.R_target_source, turn)) < 2


def test_a_fixed_number_of_matches_is_kept_even_where_more_are_free() -> None:
    points = np.random.default_rng(4).random((8, 3))
    result = match(points, points, num_matches=5)
    assert (result.map_target_source >= 0).sum() == 5
    assert result.energy == pytest.approx(0.0, abs=1e-12)


def test_a_high_penalty_is_full_matching_and_none_is_nothing() -> None:
    rng = np.random.default_rng(5)
    target, source = rng.random((9, 3)), rng.random((7, 3))
    assert match(target, source, unmatched_penalty=1e3).energy == pytest.approx(match(target, source).energy)
    free = match(target, source, unmatched_penalty=0.0)
    assert free.energy == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("options", [{"num_matches": 4}, {"unmatched_penalty": 0.05}])
def test_the_bound_of_the_relaxation_is_valid(options) -> None:
    rng = np.random.default_rng(6)
    for _ in range(3):
        problem = Problem.from_user(rng.random((6, 3)), rng.random((5, 3)), **options)
        result = match_problem(problem, MatchOptions(strategy="relaxation"))
        assert 0.0 <= result.lower_bound <= brute_force(problem).energy * (1 + 1e-9)


def test_masks_need_room_for_the_matches_only() -> None:
    allowed = np.ones((4, 4), bool)
    allowed[:, 0] = False
    points = np.random.default_rng(7).random((4, 3))
    with pytest.raises(InputError, match="allowed"):
        match(points, points, allowed=allowed)
    result = match(points, points, allowed=allowed, num_matches=3)
    np.testing.assert_array_equal(result.map_target_source, [-1, 1, 2, 3])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_matches": 3, "unmatched_penalty": 1.0}, "exclude"),
        ({"num_matches": 0}, "num_matches"),
        ({"num_matches": 7}, "num_matches"),
        ({"unmatched_penalty": -1.0}, "unmatched_penalty"),
        ({"unmatched_penalty": np.inf}, "unmatched_penalty"),
    ],
)
def test_impossible_forms_are_refused(options, message: str) -> None:
    with pytest.raises(OptionsError, match=message):
        match(np.ones((6, 3)), np.ones((6, 3)), **options)
