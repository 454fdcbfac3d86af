"""The entry point of PM-SDP: checks the problem, solves it, returns values with their proof."""

from __future__ import annotations

from importlib import import_module
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, read_only
from data_tools.checks import check_choice, check_count, check_number
from data_tools.errors import UnavailableError
from data_tools.threads import one_blas_thread
from pairwise.options import BUILT_IN, Solver
from pairwise.pm_sdp.certify import certify_dual
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.interior_point import DualSolution, solve_dual
from pairwise.problem import Problem, ProblemArguments
from pairwise.results import RelaxationResult

#: Tolerance and most iterations of each solver unless told otherwise.
SOLVERS: dict[str, tuple[float, int]] = {
    BUILT_IN: (1e-6, 100),
    "clarabel": (1e-8, 200),
    "scs": (1e-6, 100_000),
}


@one_blas_thread()
def solve_relaxation(
    target: ArrayLike,
    source: ArrayLike,
    *,
    solver: Solver = BUILT_IN,
    tol: float | None = None,
    max_iterations: int | None = None,
    time_limit_s: float | None = None,
    cross_products: bool = False,
    row_sums: bool = True,
    **problem_arguments: Unpack[ProblemArguments],
) -> RelaxationResult:
    """Bound the Procrustes matching energy from below by PM-SDP, the relaxation of Maron et al. (2016).

    With ``row_sums`` it has more linear equations than the paper's: where a target point is always matched (all are
    for k = n), its matches' shares of R add up to R. On few points they close most of the gap between bound and
    optimum; ``row_sums=False`` is PM-SDP as published (eq. 10-12 of the paper).

    CVXPY hands the same relaxation to two other solvers, written as in the paper. They serve as a check: they take 10
    to 100 times as long.

    Parameters
    ----------
    target, source : array_like, shapes (n, d) and (k, d)
        Points are rows; k <= n.
    solver : {"built-in", "clarabel", "scs"}
        `built-in` is an interior-point method for this relaxation alone. The others are called through CVXPY and
        need ``pip install 'collalign[cvxpy]'``: Clarabel is an interior-point method, for up to about 20 points, and
        SCS a first-order method, whose values and bounds are less accurate.
    tol : float, optional
        Relative gap between value and bound at which to stop, by default 1e-6. Clarabel and SCS take it as their own
        absolute and relative tolerance, by default 1e-8 and 1e-6.
    max_iterations : int, optional
        By default 100; 200 for Clarabel and 100 000 for SCS.
    time_limit_s : float, optional
        For Clarabel and SCS without the time in which CVXPY sets up the program, a second for 20 points.
    cross_products : bool
        Use the identities R_a x R_b = R_c of the 3x3 rotation blocks, stronger than conv SO(3).
    row_sums : bool
        Use the equations of target points that are always matched; False is PM-SDP as published.
    **problem_arguments
        The other arguments of :meth:`pairwise.problem.Problem.from_user`.

    Returns
    -------
    RelaxationResult
        What happens inside ends in its ``status``. The bound is valid in any case and with any solver: it is that of
        its certificate, never the value that a solver claims. Only where a solver fails (``Status.FAILED``) there is
        no certificate, and all numbers are NaN.

    Raises
    ------
    InputError
        If the points or the allowed matches do not make a problem.
    OptionsError
        If an option is out of range.
    UnavailableError
        If CVXPY or the solver is not installed.

    Examples
    --------
    >>> target = np.random.default_rng(0).random((8, 3))
    >>> found = pairwise.solve_relaxation(target, target[::-1])
    >>> bool(abs(found.lower_bound) < 1e-4)
    True
    """
    check_solver(solver)
    check_limits(tol, max_iterations, time_limit_s)
    return solve_pm_sdp(
        Problem.from_user(target, source, **problem_arguments),
        solver=solver,
        cross_products=cross_products,
        row_sums=row_sums,
        tol=tol,
        max_iterations=max_iterations,
        time_limit_s=time_limit_s,
    )


def check_solver(solver: str) -> None:
    """Refuse a solver that there is not, or that is not installed.

    Raises
    ------
    OptionsError, UnavailableError
        Naming the solver, and the command that installs it.
    """
    check_choice("solver", solver, SOLVERS)
    if solver == BUILT_IN:
        return
    try:
        import_module("cvxpy")
        import_module(solver)
    except ImportError as error:
        raise UnavailableError(
            f"solver {solver!r} cannot be used ({error}); install it with: pip install 'collalign[cvxpy]', or leave "
            f"the solver out"
        ) from None


def check_limits(tol: float | None, max_iterations: int | None, time_limit_s: float | None) -> None:
    """Refuse a tolerance or a limit that no solver can have."""
    if tol is not None:
        check_number("tol", tol, upper=1.0, positive=True)
    if max_iterations is not None:
        check_count("max_iterations", max_iterations, lower=1)
    if time_limit_s is not None:
        check_number("time_limit_s", time_limit_s, positive=True)


@one_blas_thread()
def solve_pm_sdp(
    problem: Problem,
    *,
    solver: Solver = BUILT_IN,
    cross_products: bool = False,
    row_sums: bool = True,
    tol: float | None = None,
    max_iterations: int | None = None,
    time_limit_s: float | None = None,
) -> RelaxationResult:
    """Solve PM-SDP of a checked problem by a solver that is installed.

    Parameters
    ----------
    problem : Problem
    solver, cross_products, row_sums, tol, max_iterations, time_limit_s
        See :func:`solve_relaxation`.
    """
    usual_tol, usual_iterations = SOLVERS[solver]
    tol = usual_tol if tol is None else tol
    max_iterations = usual_iterations if max_iterations is None else max_iterations
    if solver != BUILT_IN:
        from pairwise.pm_sdp.cvxpy_solve import solve_by_cvxpy

        return solve_by_cvxpy(
            problem,
            solver=solver,
            tol=tol,
            max_iterations=max_iterations,
            time_limit_s=time_limit_s,
            cross_products=cross_products,
            row_sums=row_sums,
        )
    data = RelaxationData.from_problem(problem, cross_products=cross_products, row_sums=row_sums)
    solution = solve_dual(data, tol=tol, max_iterations=max_iterations, time_limit_s=time_limit_s)
    dual = solution.dual
    certificate = certify_dual(
        problem,
        data,
        F=dual.F,
        u=dual.u,
        g=dual.g,
        y=solution.equation_multipliers,
        Y=dual.Y,
    )
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
