"""The entry point of PM-SDP: checks the problem, solves it, returns values with their proof."""

from __future__ import annotations

from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, read_only
from data_tools.checks import check_count, check_number
from data_tools.threads import one_blas_thread
from pairwise.pm_sdp.certify import certify_dual
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.interior_point import DualSolution, solve_dual
from pairwise.problem import Problem, ProblemArguments
from pairwise.results import RelaxationResult


@one_blas_thread()
def solve_relaxation(
    target: ArrayLike,
    source: ArrayLike,
    *,
    tol: float = 1e-6,
    max_iterations: int = 100,
    time_limit_s: float | None = None,
    cross_products: bool = False,
    row_sums: bool = True,
    **problem_arguments: Unpack[ProblemArguments],
) -> RelaxationResult:
    """Bound the Procrustes matching energy from below by PM-SDP, the relaxation of Maron et al. (2016).

    With ``row_sums`` it has more linear equations than the paper's: where a target point is always matched (all are
    for k = n), its matches' shares of R add up to R. On few points they close most of the gap between bound and
    optimum; ``row_sums=False`` is PM-SDP as published.

    Parameters
    ----------
    target, source : array_like, shapes (n, d) and (k, d)
        Points are rows; k <= n.
    tol : float
        Relative gap between value and bound at which to stop.
    max_iterations : int
    time_limit_s : float, optional
    cross_products : bool
        Use the identities R_a x R_b = R_c of the 3x3 rotation blocks, stronger than conv SO(3).
    row_sums : bool
        Use the equations of target points that are always matched; False is PM-SDP as published.
    **problem_arguments
        The other arguments of :meth:`pairwise.problem.Problem.from_user`.

    Returns
    -------
    RelaxationResult
        What happens inside ends in its ``status``; the bound is valid in any case.

    Raises
    ------
    InputError
        If the points or the allowed matches do not make a problem.
    OptionsError
        If an option is out of range.

    Examples
    --------
    >>> target = np.random.default_rng(0).random((8, 3))
    >>> found = pairwise.solve_relaxation(target, target[::-1])
    >>> bool(abs(found.lower_bound) < 1e-4)
    True
    """
    check_limits(tol, max_iterations, time_limit_s)
    return solve_pm_sdp(
        Problem.from_user(target, source, **problem_arguments),
        cross_products=cross_products,
        row_sums=row_sums,
        tol=tol,
        max_iterations=max_iterations,
        time_limit_s=time_limit_s,
    )


def check_limits(tol: float, max_iterations: int, time_limit_s: float | None) -> None:
    """Refuse a tolerance or a limit that no solver can have."""
    check_number("tol", tol, upper=1.0, positive=True)
    check_count("max_iterations", max_iterations, lower=1)
    if time_limit_s is not None:
        check_number("time_limit_s", time_limit_s, positive=True)


@one_blas_thread()
def solve_pm_sdp(
    problem: Problem,
    *,
    cross_products: bool = False,
    row_sums: bool = True,
    tol: float = 1e-6,
    max_iterations: int = 100,
    time_limit_s: float | None = None,
) -> RelaxationResult:
    """Solve PM-SDP of a checked problem by the interior-point method.

    Parameters
    ----------
    problem : Problem
    cross_products, row_sums, tol, max_iterations, time_limit_s
        See :func:`solve_relaxation`.
    """
    data = RelaxationData.from_problem(problem, cross_products=cross_products, row_sums=row_sums)
    solution = solve_dual(data, tol=tol, max_iterations=max_iterations, time_limit_s=time_limit_s)
    certificate = certify_dual(problem, data, solution)
    x, B, R, C = full_variables(data, solution)
    return RelaxationResult(
        value=solution.value,
        lower_bound=certificate.bound,
        R=R,
        X=x,
        C=C,
        B=B,
        status=solution.status,
        certificate=certificate,
    )


def full_variables(data: RelaxationData, solution: DualSolution) -> tuple[FloatArray, ...]:
    """Return X (n, k), B (k, r, n), R (d, d) and C (r, r) over all matches and all free entries of R."""
    primal, lifted = solution.primal, data.lifted
    size = lifted.num_variables
    moments = np.empty((size + 1, size + 1))
    moments[0, 0], moments[0, 1:], moments[1:, 0], moments[1:, 1:] = (
        1.0,
        primal.R,
        primal.R,
        primal.C,
    )
    entries = lifted.basis @ moments[:, 0]
    C = lifted.basis @ moments @ lifted.basis.T
    lifted_B = np.concatenate([primal.x[..., None], primal.B], axis=2) @ lifted.basis.T
    x = data.scatter(primal.x)
    B = np.ascontiguousarray(data.scatter(lifted_B).transpose(1, 2, 0))
    return read_only(x), read_only(B), read_only(lifted.pattern.unpack(entries)), read_only(C)
