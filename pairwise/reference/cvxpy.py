"""Running SCS or Clarabel on a CVXPY problem, with this project's options and statuses."""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

from data_tools.errors import OptionsError
from pairwise.status import Status

#: Iterations after which each solver gives up unless told otherwise.
DEFAULT_MAX_ITERATIONS = {"scs": 100_000, "clarabel": 200}


def cvxpy_module() -> Any:
    """Return CVXPY, imported when first needed: it takes about a second, and its functions carry no types.

    Raises
    ------
    OptionsError
        If it cannot be imported.
    """
    try:
        return import_module("cvxpy")
    except ImportError as error:
        raise OptionsError(
            f"the solvers scs and clarabel are called through CVXPY, which cannot be imported ({error}); "
            "install it with: pip install cvxpy"
        ) from error


def solve_program(
    program: Any,
    *,
    solver: str,
    tol: float,
    max_iterations: int | None = None,
    time_limit_s: float | None = None,
) -> Status:
    """Run one of the two solvers on a CVXPY problem and say how it ended; the values stay in the problem."""
    cp = cvxpy_module()

    settings = _solver_settings(solver, tol, max_iterations, time_limit_s)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")  # the status says so
            program.solve(solver=solver.upper(), **settings)
    except cp.error.SolverError:
        return Status.FAILED
    except BaseException as error:  # Clarabel panics on some ill-posed programs, outside the Exception hierarchy
        if type(error).__name__ != "PanicException":
            raise
        return Status.FAILED
    if program.status == cp.OPTIMAL:
        return Status.CONVERGED
    if program.status not in (cp.OPTIMAL_INACCURATE, cp.USER_LIMIT):
        return Status.FAILED
    stats = program.solver_stats
    if time_limit_s is not None and (stats.solve_time or 0.0) >= 0.9 * time_limit_s:
        return Status.TIME_LIMIT
    limit = max_iterations or DEFAULT_MAX_ITERATIONS[solver]
    return Status.ITERATION_LIMIT if (stats.num_iters or 0) >= limit else Status.STALLED


def check_limits(tol: float, max_iterations: int | None, time_limit_s: float | None) -> None:
    """Refuse a tolerance or a limit that no solver can have."""
    if not 0 < tol < 1:
        raise OptionsError(f"tol: expected a number between 0 and 1, got {tol}")
    if max_iterations is not None and max_iterations < 1:
        raise OptionsError(f"max_iterations: expected 1 or more, got {max_iterations}")
    if time_limit_s is not None and not time_limit_s > 0:
        raise OptionsError(f"time_limit_s: expected a positive number, got {time_limit_s}")


def _solver_settings(
    solver: str, tol: float, max_iterations: int | None, time_limit_s: float | None
) -> dict[str, float]:
    if solver not in DEFAULT_MAX_ITERATIONS:
        raise OptionsError(f"solver: expected 'scs' or 'clarabel', got {solver!r}")
    check_limits(tol, max_iterations, time_limit_s)
    limit = max_iterations or DEFAULT_MAX_ITERATIONS[solver]
    if solver == "scs":
        settings = {"eps_abs": tol, "eps_rel": tol, "max_iters": limit}
        return settings if time_limit_s is None else {**settings, "time_limit_secs": time_limit_s}
    settings = {"tol_gap_abs": tol, "tol_gap_rel": tol, "tol_feas": tol, "max_iter": limit}
    return settings if time_limit_s is None else {**settings, "time_limit": time_limit_s}
