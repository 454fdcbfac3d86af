"""The built-in solver against the CVXPY reference, brute force and theory."""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from data_tools.errors import OptionsError
from pairwise import solve_relaxation, verify_certificate
from pairwise.pm_sdp import interior_point
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import Status
from tests.oracles import brute_force, check_relaxation
from tests.problems import catalogue, in_unit, planted, random_rotation
from tests.relaxation_problems import Comparison, compare_with_reference, variants


@settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    database=None,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
@given(variants(max_points=6))
def test_agrees_with_the_reference(variant):
    assert compare_with_reference(variant).faults(2e-5) == [], variant.description


def test_comparison_rejects_wrong_values():
    assert Comparison(1e-3, 1e-7).faults(1e-5)
    assert Comparison(-1e-3, 1e-7).faults(1e-5)
    assert Comparison(0.0, -1e-9).faults(1e-5)
    assert Comparison(0.0, 1e-3).faults(1e-5)
    assert Comparison(0.0, 1e-7, 1e-3).faults(1e-5)
    assert Comparison(0.0, 1e-7, -1e-6).faults(1e-5)
    assert Comparison(0.0, 1e-7, 0.0, ("X is not stochastic",)).faults(1e-5)
    assert not Comparison(-1e-6, 1e-7).faults(1e-5)


@pytest.mark.parametrize("known", catalogue(), ids=lambda known: known.name)
def test_few_steps_lead_to_a_bound_below_the_optimum(known):
    problem = known.problem
    result = solve_pm_sdp(problem, max_iterations=20)
    assert result.status is not Status.ITERATION_LIMIT, "Newton steps that are wrong need more"
    optimum = brute_force(problem).energy if np.isnan(known.optimum) else known.optimum
    scale = 1e-9 + float((problem.weights * (problem.source**2).sum(axis=1)).sum())
    assert result.lower_bound <= result.value + 1e-12 * scale
    assert result.lower_bound <= optimum + 1e-12 * scale
    assert result.value <= optimum + 1e-5 * scale
    assert check_relaxation(problem, result, 1e-6) == []


#: Points of fewer dimensions than they have coordinates.
FLAT = [k for k in catalogue() if np.linalg.matrix_rank(k.problem.target) < k.problem.dim]


@pytest.mark.parametrize("unit", [1e-6, 1e6])
@pytest.mark.parametrize("known", FLAT, ids=lambda known: known.name)
def test_flat_points_are_solved_in_every_unit(known, unit):
    problem = in_unit(known.problem, unit)
    result = solve_pm_sdp(problem)
    size = unit**2 * (1.0 + (known.problem.source**2).sum())
    size = size if problem.source.any() else 1.0  # zeros have no scale
    assert result.lower_bound <= unit**2 * known.optimum + 1e-12 * size
    assert abs(result.value - result.lower_bound) < 1e-5 * size


@pytest.mark.parametrize("group", ["SO", "O"])
@pytest.mark.parametrize("seed", range(4))
def test_row_sums_raise_the_bound_but_not_beyond_the_optimum(group, seed):
    rng = np.random.default_rng(seed)
    num = 4 + seed % 3
    problem = planted(rng, rng.random((num, 3)), noise=(0.1, 0.4)[seed % 2], group=group)
    published, tighter = (solve_pm_sdp(problem, row_sums=row_sums) for row_sums in (False, True))
    scale = float((problem.source**2).sum())
    assert tighter.lower_bound > published.value - 1e-6 * scale
    assert tighter.lower_bound <= brute_force(problem).energy + 1e-12 * scale
    assert "row_u" not in published.certificate.arrays
    assert check_relaxation(problem, tighter, 1e-6, row_sums=True) == []
    assert check_relaxation(problem, published, 1e-6, row_sums=True) != []
    assert check_relaxation(problem, published, 1e-6) == []


def test_row_sums_can_prove_what_the_published_relaxation_does_not(rng):
    problem = planted(rng, rng.random((6, 3)), noise=0.1, group="O")
    optimum = brute_force(problem).energy
    assert solve_pm_sdp(problem, row_sums=False).value < 0.9 * optimum
    assert solve_pm_sdp(problem).lower_bound >= 0.99 * optimum


@pytest.mark.parametrize("num_target", [40, 56])
def test_exact_recovery_without_noise(rng, num_target):
    target = rng.random((num_target, 3))
    rotation, matched = random_rotation(rng, 3), rng.permutation(num_target)[:40]
    allowed = np.zeros((num_target, 40), dtype=bool)
    allowed[rng.integers(0, num_target, (20, 40)), np.arange(40)] = True
    allowed[matched, np.arange(40)] = True
    result = solve_relaxation(
        target, target[matched] @ rotation, allowed=None if num_target == 40 else allowed
    )
    assert np.array_equal(result.X.argmax(axis=0), matched)
    assert np.abs(result.R - rotation).max() < 0.02
    assert abs(result.value) < 1e-3
    assert result.lower_bound <= 1e-9


def test_limits_end_in_statuses_with_valid_bounds(rng):
    target, source = rng.random((8, 3)), rng.random((8, 3))
    best = solve_relaxation(target, source)
    few = solve_relaxation(target, source, max_iterations=3)
    none = solve_relaxation(target, source, time_limit_s=1e-9)
    assert few.status is Status.ITERATION_LIMIT
    assert none.status is Status.TIME_LIMIT
    for result in (few, none):
        assert result.lower_bound <= best.value + 1e-9
        assert result.value >= best.lower_bound - 1e-6
        assert verify_certificate(target, source, result.certificate) == result.lower_bound


@pytest.mark.parametrize(
    "options",
    [{"tol": 0.0}, {"max_iterations": 0}, {"time_limit_s": -1.0}],
)
def test_impossible_options_are_refused(options):
    with pytest.raises(OptionsError):
        solve_relaxation(np.eye(3), np.eye(3), **options)


@pytest.mark.parametrize("stops", ["primal", "dual", "short"])
def test_a_step_that_arithmetic_does_not_allow_ends_with_the_best_point_so_far(
    stops, rng, monkeypatch
):
    target = rng.random((8, 3))
    if stops == "short":
        corrected = interior_point._InteriorPoint._corrected_step
        monkeypatch.setattr(
            interior_point._InteriorPoint,
            "_corrected_step",
            lambda self: (corrected(self)[0], (1e-12, 1e-12)),
        )
    else:
        monkeypatch.setattr(interior_point, f"move_{stops}", lambda *arguments: None)
    result = solve_relaxation(target, target @ random_rotation(rng, 3))
    assert result.status is Status.STALLED
    assert result.lower_bound <= 1e-9
