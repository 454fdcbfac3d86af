"""The matcher: global optimum on the catalogue, alternatives, chirality, proof, invariances, refusals."""

import time
import warnings

import numpy as np
import pytest

from data_tools.errors import InputError, OptionsError
from data_tools.poses import SAME_DEG
from data_tools.rotations import rotation_angles
from pairwise import MatchOptions, match
from pairwise.matching import match_problem
from pairwise.portfolio import wants_relaxation
from pairwise.problem import Problem
from pairwise.results import Status
from pairwise.rotation_search import explore
from pairwise.rotation_sets import random_rotations
from tests.oracles import brute_force, check_pose
from tests.problems import catalogue, planted


@pytest.mark.parametrize("known", catalogue(), ids=lambda known: known.name)
def test_the_best_pose_is_the_global_optimum(known):
    result = match_problem(known.problem, MatchOptions())
    best = brute_force(known.problem).energy
    assert result.energy == pytest.approx(best, rel=1e-5, abs=1e-9)
    for candidate in result.candidates:
        pose = candidate.R_target_source, candidate.map_target_source
        assert not check_pose(known.problem, *pose, candidate.energy)


@pytest.mark.parametrize(
    ("dim", "strategy"),
    [(d, s) for d in (2, 3) for s in ("search", "relaxation", "portfolio")]
    + [(5, "relaxation"), (7, "portfolio")],
)
def test_every_strategy_recovers_exactly_without_noise(dim, strategy):
    rng = np.random.default_rng(dim)
    target = rng.random((9, dim)) - 0.5
    turn, point_map = random_rotations(dim, 1, rng)[0], rng.permutation(9)[:7]
    result = match(target, target[point_map] @ turn, strategy=strategy)
    np.testing.assert_array_equal(result.map_target_source, point_map)
    np.testing.assert_allclose(result.R_target_source, turn, atol=1e-7)
    assert result.energy == pytest.approx(0.0, abs=1e-12)


def test_candidates_are_distinct_ordered_and_near_the_best():
    rng = np.random.default_rng(3)
    problem = planted(rng, rng.random((20, 3)) - 0.5, noise=0.5)
    options = MatchOptions(max_candidates=5, candidate_factor=1.2)
    result = match_problem(problem, options)
    energies = [c.energy for c in result.candidates]
    assert 1 < len(energies) <= 5
    assert energies == sorted(energies)
    assert energies[-1] <= 1.2 * energies[0]
    assert result.energy == energies[0]
    np.testing.assert_array_equal(result.R_target_source, result.candidates[0].R_target_source)
    turns = np.stack([c.R_target_source for c in result.candidates])
    for i, turn in enumerate(turns):
        assert (rotation_angles(turns[:i], turn) >= np.deg2rad(SAME_DEG)).all()


@pytest.mark.parametrize("pattern", [None, (3, 2), 0])
def test_the_relaxation_bounds_the_energy(pattern):
    rng = np.random.default_rng(6)
    dim = 5 if pattern == (3, 2) else 4
    turn = np.eye(dim) if pattern is not None else None
    group = "O" if pattern == 0 else "SO"
    problem = planted(
        rng, rng.random((6, dim)), noise=0.1, rotation=turn, rotation_pattern=pattern, group=group
    )
    result = match_problem(problem, MatchOptions(strategy="relaxation"))
    best = brute_force(problem).energy
    assert 0.0 <= result.lower_bound <= best * (1 + 1e-9)
    assert result.energy >= best * (1 - 1e-9)
    assert result.certificate is not None


def test_the_relaxation_is_solved_by_the_documented_rule():
    rng = np.random.default_rng(0)
    rigid, deep = planted(rng, rng.random((6, 3))), planted(rng, rng.random((6, 8)), noise=0.1)
    mixed = Problem.from_user(rng.random((6, 7)), rng.random((6, 7)), rotation_pattern=(3, 4))
    portfolio = MatchOptions()
    assert [wants_relaxation(p, portfolio) for p in (rigid, mixed, deep)] == [False, False, True]
    assert wants_relaxation(rigid, MatchOptions(strategy="relaxation"))
    assert not wants_relaxation(deep, MatchOptions(strategy="search"))
    assert not wants_relaxation(rigid, MatchOptions(certify=True))
    assert wants_relaxation(deep, MatchOptions(strategy="search", certify=True))
    exact = planted(rng, rng.random((6, 8)), rotation=np.eye(8))
    assert [wants_relaxation(p, portfolio, explore(p)) for p in (deep, exact)] == [True, False]


def test_a_time_limit_holds_within_an_iteration_of_the_relaxation():
    rng = np.random.default_rng(5)
    problem = planted(rng, rng.random((60, 5)), noise=0.1)
    began_s = time.perf_counter()
    result = match_problem(problem, MatchOptions(strategy="relaxation", time_limit_s=0.5))
    assert time.perf_counter() - began_s < 5.0  # one iteration takes longer
    assert result.status is Status.TIME_LIMIT
    assert result.log[0].endswith(Status.TIME_LIMIT.value)
    assert 0.0 <= result.lower_bound <= result.energy


@pytest.mark.parametrize("num_source", [None, 11])
def test_relabelling_and_turning_change_labels_and_turns_only(num_source):
    rng = np.random.default_rng(10)
    problem = planted(rng, rng.random((15, 3)) - 0.5, noise=0.2, num_source=num_source)
    turns = random_rotations(3, 2, rng)
    orders = rng.permutation(problem.num_target), rng.permutation(problem.num_source)
    plain = match(problem.target, problem.source)
    moved = match(
        (problem.target @ turns[0].T)[orders[0]], (problem.source @ turns[1].T)[orders[1]]
    )
    assert moved.energy == pytest.approx(plain.energy)
    np.testing.assert_array_equal(
        orders[0][moved.map_target_source], plain.map_target_source[orders[1]]
    )
    np.testing.assert_allclose(
        turns[0].T @ moved.R_target_source @ turns[1], plain.R_target_source, atol=1e-7
    )


def test_clouds_with_other_centroids_are_shifted_on_request():
    rng = np.random.default_rng(13)
    points, turn, shift = (
        rng.random((12, 3)),
        random_rotations(3, 1, rng)[0],
        np.array([5.0, -3.0, 1.0]),
    )
    source = (points - shift) @ turn
    result = match(points, source, translation=True)
    np.testing.assert_allclose(result.R_target_source, turn, atol=1e-9)
    for pose in (result, *result.candidates):
        moved = source @ pose.R_target_source.T + pose.translation
        apart = ((moved - points[pose.map_target_source]) ** 2).sum()
        assert apart == pytest.approx(pose.energy, abs=1e-9)
    np.testing.assert_allclose(result.translation, shift, atol=1e-9)
    alone = match(points, source)
    assert alone.translation is None
    assert alone.energy > 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"strategy": "luck"}, "strategy"),
        ({"starts": np.ones((3, 3))}, "starts"),
        ({"starts": -np.eye(3)}, "reflection"),
        ({"time_limit_s": 0}, "time_limit_s"),
        ({"seed": -1}, "seed"),
    ],
)
def test_bad_options_are_refused_by_name(options, message):
    with pytest.raises((InputError, OptionsError), match=message):
        match(np.ones((3, 3)), np.ones((3, 3)), **options)


@pytest.mark.parametrize(
    "fields", [{"candidate_factor": 0.9}, {"max_candidates": 0}, {"num_draws": -1}]
)
def test_impossible_options_are_refused(fields):
    with pytest.raises(OptionsError):
        MatchOptions(**fields)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("dim", [2, 3])
def test_points_at_the_origin_behind_a_mask_are_proven_in_every_unit(unit, dim):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        target, source = unit * rng.random((5, dim)), unit * rng.random((5, dim))
        target[:2], source[:1] = 0.0, 0.0
        allowed = (rng.random((5, 5)) < 0.5) | np.eye(5, dtype=bool)
        result = match(target, source, allowed=allowed, certify=True)
        assert result.status is Status.PROVEN_OPTIMAL
        optimum = brute_force(Problem.from_user(target, source, allowed=allowed)).energy
        assert result.energy == pytest.approx(optimum, rel=1e-9)
        assert optimum * (1 - 2e-3) <= result.lower_bound <= optimum * (1 + 1e-12)


def test_centroids_that_a_pose_about_the_origin_cannot_bring_together_are_said(rng):
    target = rng.random((20, 3))
    with pytest.warns(UserWarning, match="poses rotate about the origin. Use translation=True"):
        match(target, target + np.array([3.0, 0.0, 0.0]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        match(target, target + np.array([3.0, 0.0, 0.0]), translation=True)
        match(target, target[:9])
        match(target[:1], 3.0 * target[:1])
        match(target, target + 0.05 * rng.standard_normal(target.shape))
    beyond = np.concatenate([target, target[:4] + np.array([2.0, 0.0, 0.0])])
    with pytest.warns(UserWarning, match="no partner. Use translation=True with a large unmatched"):
        match(beyond, target, translation=True)
    assert match(beyond, target, translation=True, unmatched_cost=100.0).energy < 1e-9
