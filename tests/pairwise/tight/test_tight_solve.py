from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import OptionsError
from pairwise.certificates.verify import verify_certificate
from pairwise.local.rotation_sets import random_rotations
from pairwise.problem.problem import Problem
from pairwise.relaxations import solve_relaxation
from pairwise.status import Status
from pairwise.tight.problem import energy_scale
from pairwise.tight.solve import solve_tight
from tests.oracles import brute_force, check_relaxation
from tests.tight_problems import planted_cube, small_problem
from tests.tight_reference import solve_tight_reference


@pytest.mark.parametrize("form", ["tight", "quaternion"])
@pytest.mark.parametrize("seed", range(35))
def test_bounds_are_valid_and_their_certificates_hold(seed, form):
    problem = small_problem(seed)
    result = solve_tight(problem, form=form, max_iterations=400, tol=1e-3)
    optimum = brute_force(problem).energy
    scale = energy_scale(problem)
    assert result.lower_bound <= optimum + 1e-11 * scale
    assert result.value <= optimum + 1e-9 * scale
    verified = verify_certificate(problem.target, problem.source, result.certificate)
    assert verified == pytest.approx(result.lower_bound, abs=1e-8 * scale)
    assert verified <= optimum + 1e-11 * scale
    assert np.linalg.eigvalsh(result.moments)[-1] > 0.0


def test_brute_force_would_reject_a_bound_that_is_too_high():
    problem = small_problem(0)
    optimum = brute_force(problem).energy
    assert solve_tight(problem).lower_bound + 1e-3 * energy_scale(problem) > optimum


@pytest.mark.parametrize("form", ["tight", "quaternion"])
@pytest.mark.parametrize("seed", [1, 3, 7, 8, 10])
def test_the_plain_relaxation_has_the_value_of_the_reference(seed, form):
    problem = small_problem(seed, max_target=4)
    value, status = solve_tight_reference(problem, form=form, solver="clarabel", tol=1e-7)
    assert status is Status.CONVERGED
    result = solve_tight(problem, form=form, eliminate=False, tol=1e-5, max_iterations=6000)
    scale = energy_scale(problem)
    assert result.value == pytest.approx(value, abs=1e-4 * scale)
    assert result.lower_bound <= value + 1e-6 * scale
    assert result.lower_bound >= value - 1e-4 * scale


def test_the_tight_primal_point_satisfies_pm_sdp():
    for seed in (7, 14):
        problem = small_problem(seed, max_target=5)
        result = solve_tight(problem, eliminate=False, tol=1e-6, max_iterations=8000)
        assert check_relaxation(problem, result, 2e-3) == []
        wrong = replace(result, X=result.X[::-1])
        assert check_relaxation(problem, wrong, 2e-3) != []


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_tight_dominates_pm_sdp_and_the_quaternion_form(seed):
    target, source = planted_cube(8, 0.15, seed)
    tight = solve_relaxation(target, source, relaxation="tight", tol=1e-4).lower_bound
    plain = solve_tight(Problem.from_user(target, source), eliminate=False, tol=1e-4).lower_bound
    pm_sdp = solve_relaxation(target, source, cross_products=True, tol=1e-4).lower_bound
    quaternion = solve_tight(Problem.from_user(target, source), form="quaternion", eliminate=False, tol=1e-4)
    slack = 2e-4 * energy_scale(Problem.from_user(target, source))
    assert pm_sdp <= plain + slack
    assert quaternion.lower_bound <= plain + slack
    assert plain <= tight + slack


@pytest.mark.parametrize(("num_source", "group"), [(12, "SO"), (9, "SO"), (12, "O")])
def test_without_noise_the_planted_pose_is_exact(num_source, group):
    target, source = planted_cube(12, 0.0, 5, num_source=num_source)
    if group == "O":
        source = -source
    result = solve_tight(Problem.from_user(target, source, group=group), tol=1e-4)
    assert result.lower_bound == pytest.approx(0.0, abs=1e-9)
    assert result.status is Status.CONVERGED
    moved = source @ result.R.T
    np.testing.assert_allclose(moved, target[result.X.argmax(axis=0)], atol=1e-5)
    assert np.linalg.det(result.R) == pytest.approx(-1.0 if group == "O" else 1.0, abs=1e-6)
    np.testing.assert_allclose(result.B.sum(axis=2), np.tile(result.R.T.ravel(), (num_source, 1)), atol=1e-9)


def test_small_noise_is_solved_exactly_and_elimination_changes_no_optimum():
    target, source = planted_cube(14, 0.05, 3)
    problem = Problem.from_user(target, source)
    fast = solve_tight(problem)
    plain = solve_tight(problem, eliminate=False)
    assert fast.lower_bound == pytest.approx(fast.value, rel=1e-4)
    assert plain.lower_bound == pytest.approx(fast.lower_bound, rel=2e-3)
    np.testing.assert_array_equal(fast.X.argmax(axis=0), plain.X.argmax(axis=0))
    assert np.linalg.eigvalsh(fast.moments)[-2] < 1e-6


def test_the_value_does_not_depend_on_poses_and_order():
    target, source = planted_cube(7, 0.1, 1)
    base = solve_tight(Problem.from_user(target, source), tol=1e-5)
    turn = random_rotations(3, 2, np.random.default_rng(4))
    order = np.random.default_rng(5).permutation(7)
    other = solve_tight(Problem.from_user(target @ turn[0].T, source[order] @ turn[1].T), tol=1e-5)
    assert other.lower_bound == pytest.approx(base.lower_bound, rel=1e-3)
    np.testing.assert_allclose(turn[0] @ base.R @ turn[1].T, other.R, atol=1e-2)


def test_the_same_problem_gives_the_same_numbers():
    problem = small_problem(7)
    first, second = solve_tight(problem), solve_tight(problem)
    assert first.lower_bound == second.lower_bound
    np.testing.assert_array_equal(first.moments, second.moments)


def test_limits_end_the_iteration_with_a_valid_bound():
    problem = Problem.from_user(*planted_cube(12, 0.2, 0))
    short = solve_tight(problem, max_iterations=60)
    assert short.status is Status.ITERATION_LIMIT
    timed = solve_tight(problem, time_limit_s=1e-6, max_iterations=100_000, tol=1e-9)
    assert timed.status is Status.TIME_LIMIT
    best = solve_tight(problem).value
    assert max(short.lower_bound, timed.lower_bound) <= best * (1 + 1e-6)


def test_what_is_not_for_this_relaxation_is_refused():
    target, source = planted_cube(6, 0.1, 0)
    with pytest.raises(OptionsError, match="form"):
        solve_tight(Problem.from_user(target, source), form="loose")
    with pytest.raises(OptionsError, match="tol"):
        solve_tight(Problem.from_user(target, source), tol=0.0)
    with pytest.raises(OptionsError, match="dimension 2 or 3"):
        solve_tight(Problem.from_user(np.eye(4), np.eye(4)))
    with pytest.raises(OptionsError, match="full matrix"):
        solve_tight(Problem.from_user(target, source, rotation_pattern=1))
    with pytest.raises(OptionsError, match="partial"):
        solve_tight(Problem.from_user(target, source, num_matches=4))


@pytest.mark.parametrize("form", ["tight", "quaternion"])
@pytest.mark.parametrize("limits", [{"max_iterations": 1}, {"max_iterations": 5}, {"time_limit_s": 1e-6}])
def test_a_run_that_ends_right_after_dropping_matches_has_a_whole_answer(form, limits):
    rng = np.random.default_rng(8)
    for _ in range(6):
        target, source = rng.random((6, 3)), rng.random((6, 3))
        result = solve_relaxation(target, source, relaxation=form, **limits)
        problem = Problem.from_user(target, source)
        assert result.lower_bound <= brute_force(problem).energy
        assert np.allclose(result.X.sum(axis=0), 1.0)
        assert np.isfinite(result.residuals["primal"])
        assert verify_certificate(target, source, result.certificate, problem=problem) <= brute_force(problem).energy
