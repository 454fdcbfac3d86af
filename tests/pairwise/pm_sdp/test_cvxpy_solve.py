"""Clarabel and SCS agree with the built-in solver, and what they prove is proven."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import OptionsError, UnavailableError
from pairwise import match, solve_relaxation, verify_certificate
from pairwise.pm_sdp import cvxpy_solve
from pairwise.pm_sdp.cvxpy_model import build_model
from pairwise.problem import Problem, with_unmatched
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import Status
from tests.oracles import brute_force

#: Matches of which some are in no assignment: points 0 and 1 share targets 0 and 1.
FORCED = np.array(
    [[1, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1], [0, 0, 0, 1]], dtype=bool
)


def noisy(seed, num_target, num_source, dim=3, **arguments):
    rng = np.random.default_rng(seed)
    target = rng.random((num_target, dim))
    source = target[rng.permutation(num_target)[:num_source]]
    source = source + 0.2 * rng.standard_normal(source.shape)
    return Problem.from_user(target, source, **arguments)


@pytest.mark.parametrize(
    "problem",
    [noisy(5, 5, 3), with_unmatched(noisy(13, 5, 4), 0.1), noisy(7, 5, 4, allowed=FORCED)],
    ids=["fewer source points", "unmatched points", "forced"],
)
@pytest.mark.parametrize(("solver", "tol"), [("clarabel", 1e-5), ("scs", 1e-3)])
def test_results_are_those_of_the_built_in_solver(problem, solver, tol):
    result, own = solve_pm_sdp(problem, solver=solver), solve_pm_sdp(problem)
    assert result.lower_bound == pytest.approx(own.lower_bound, rel=tol)
    assert result.value == pytest.approx(own.value, rel=tol)
    for name in ("R", "X", "C", "B"):
        assert getattr(result, name).shape == getattr(own, name).shape
        assert not getattr(result, name).flags.writeable


@pytest.mark.parametrize("solver", ["clarabel", "scs"])
@pytest.mark.parametrize("max_iterations", [1, 3, 10, 30])
def test_what_stops_early_still_proves_its_bound(solver, max_iterations):
    problem = noisy(20, 5, 5)
    result = solve_pm_sdp(problem, solver=solver, tol=1e-12, max_iterations=max_iterations)
    assert result.status in (Status.ITERATION_LIMIT, Status.STALLED)
    assert result.lower_bound <= brute_force(problem).energy
    again = verify_certificate(problem.target, problem.source, result.certificate, problem=problem)
    assert again == result.lower_bound


def test_the_value_that_a_solver_claims_is_not_the_bound():
    problem = noisy(21, 6, 6)
    rough = solve_pm_sdp(problem, solver="scs", tol=1e-3)
    best = solve_pm_sdp(problem, tol=1e-7)
    assert rough.lower_bound < best.lower_bound
    assert abs(rough.value - best.value) > 1e-6


def test_limits_are_statuses():
    problem = noisy(23, 6, 6)
    few = solve_pm_sdp(problem, solver="scs", tol=1e-9, max_iterations=50)
    assert few.status is Status.ITERATION_LIMIT
    stopped = solve_pm_sdp(problem, solver="clarabel", tol=1e-9, max_iterations=3)
    assert stopped.status is Status.ITERATION_LIMIT
    for solver in ("clarabel", "scs"):
        late = solve_pm_sdp(problem, solver=solver, tol=1e-12, time_limit_s=1e-9)
        assert late.status is Status.TIME_LIMIT
        assert late.lower_bound <= solve_pm_sdp(problem).lower_bound


@pytest.mark.parametrize(
    "error", [cvxpy_solve.cp.error.SolverError, type("PanicException", (BaseException,), {})]
)
def test_a_solver_that_fails_leaves_no_numbers_and_no_bound(error, monkeypatch):
    def fail(*arguments, **settings):
        raise error("no")

    monkeypatch.setattr(cvxpy_solve.cp.Problem, "solve", fail)
    target = np.random.default_rng(0).random((5, 3))
    result = solve_relaxation(target, target[:4], solver="scs", allowed=FORCED)
    assert result.status is Status.FAILED
    assert result.certificate is None
    for name in ("value", "lower_bound", "R", "X", "C", "B"):
        assert np.isnan(getattr(result, name)).all()
    found = match(target, target[:4], strategy="relaxation", solver="scs")
    assert found.energy == pytest.approx(0.0, abs=1e-12), "by search"
    assert Status.FAILED.value in found.log[0]


def test_other_errors_are_not_hidden(monkeypatch):
    monkeypatch.setattr(
        cvxpy_solve.cp.Problem, "solve", lambda *a, **s: (_ for _ in ()).throw(KeyboardInterrupt)
    )
    with pytest.raises(KeyboardInterrupt):
        solve_pm_sdp(noisy(24, 4, 4), solver="scs")


@pytest.mark.parametrize("package", ["cvxpy", "scs"])
def test_a_missing_package_is_named_before_anything_is_solved(package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    points = np.eye(3)
    for solve in (solve_relaxation, match):
        with pytest.raises(UnavailableError, match=r"scs.*pip install 'collalign\[cvxpy\]'"):
            solve(points, points, solver="scs")
        solve(points, points)
    if package == "scs":
        assert solve_relaxation(points, points, solver="clarabel").status is Status.CONVERGED


def test_an_unknown_solver_is_refused():
    for solve in (solve_relaxation, match):
        with pytest.raises(OptionsError, match=r"solver.*'mosek'"):
            solve(np.eye(3), np.eye(3), solver="mosek")


def test_a_certificate_needs_the_multipliers_of_its_own_problem():
    problem = noisy(26, 4, 4)
    other = replace(problem, source=problem.source[::-1].copy())
    model = build_model(problem)
    cvxpy_solve.solve_model(model, solver="clarabel", tol=1e-8, max_iterations=200)
    certificate = cvxpy_solve.certify_model(replace(model, problem=other))
    assert certificate.bound < cvxpy_solve.certify_model(model).bound
