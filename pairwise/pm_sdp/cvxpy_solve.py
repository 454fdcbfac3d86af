"""PM-SDP by SCS and Clarabel through CVXPY, with a bound that is proven although the solvers are inexact.

Nothing that a solver returns is trusted: its dual variables become a certificate, as those of the built-in solver do
(:mod:`pairwise.pm_sdp.certify`). Inexact ones are first moved into the interior of their cones.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import cvxpy as cp
import numpy as np
import scipy

from data_tools.arrays import FloatArray, read_only
from pairwise.certificates.certificate import Certificate
from pairwise.pm_sdp.certify import certify_dual
from pairwise.pm_sdp.cvxpy_model import CvxpyModel, build_model, summed_rows
from pairwise.pm_sdp.moment_basis import MomentBasis
from pairwise.problem import Problem
from pairwise.results import RelaxationResult, Status

#: Powers of ten between which the best shift of F is searched, relative to its largest entry.
_SHIFTS = (-14.0, 0.0)


def solve_by_cvxpy(
    problem: Problem,
    *,
    solver: str,
    tol: float,
    max_iterations: int,
    time_limit_s: float | None = None,
    cross_products: bool = False,
    row_sums: bool = True,
) -> RelaxationResult:
    """Solve PM-SDP through CVXPY.

    Parameters
    ----------
    problem : Problem
        Any variant: k <= n, allowed matches, patterns of R, rotation blocks, weights, constant costs.
    solver : {"clarabel", "scs"}
        Clarabel is an interior-point method (accurate, up to about 20 points), SCS a first-order method.
    tol : float
        The solver's absolute and relative tolerance.
    max_iterations : int
    time_limit_s : float, optional
        Seconds for the solver itself, without CVXPY's set-up.
    cross_products, row_sums
        See :func:`pairwise.solve_relaxation`.

    Returns
    -------
    RelaxationResult
        ``status`` is the solver's. Where it failed, all numbers are NaN and there is no certificate.
    """
    model = build_model(problem, cross_products=cross_products, row_sums=row_sums)
    result = solve_model(
        model, solver=solver, tol=tol, max_iterations=max_iterations, time_limit_s=time_limit_s
    )
    if result.status is Status.FAILED:
        return result
    certificate = certify_model(model)
    return replace(result, lower_bound=certificate.bound, certificate=certificate)


def solve_model(
    model: CvxpyModel,
    *,
    solver: str,
    tol: float,
    max_iterations: int,
    time_limit_s: float | None = None,
) -> RelaxationResult:
    """Solve a model built by :func:`build_model`; nothing is proven: ``lower_bound`` is NaN.

    Parameters
    ----------
    model : CvxpyModel
    solver, tol, max_iterations, time_limit_s
        See :func:`solve_by_cvxpy`.
    """
    status = _solve_program(
        model.program,
        solver=solver,
        tol=tol,
        max_iterations=max_iterations,
        time_limit_s=time_limit_s,
    )
    problem, basis, num = model.problem, model.basis, len(model.source_index)
    r, s = basis.shape
    value = elsewhere = math.nan
    if status is Status.FAILED or model.x.value is None:
        status = Status.FAILED
        x, b, c, rho = (np.full(shape, np.nan) for shape in (num, (s, num), (s, s), s))
    else:
        elsewhere = 0.0
        value = float(model.objective.value) * model.scale + model.constant
        x, b, c, rho = (np.asarray(v.value, float) for v in (model.x, model.b, model.c, model.rho))
    matches = np.full((problem.num_target, problem.num_source), elsewhere)
    matches[model.target_index, model.source_index] = x
    lifted = np.full((problem.num_source, r, problem.num_target), elsewhere)
    lifted[model.source_index, :, model.target_index] = (basis @ b).T
    return RelaxationResult(
        value=value,
        lower_bound=math.nan,
        R=read_only(problem.pattern.unpack(basis @ rho)),
        X=read_only(matches),
        C=read_only(basis @ (0.5 * (c + c.T)) @ basis.T),
        B=read_only(lifted),
        status=status,
    )


def _solve_program(
    program: Any, *, solver: str, tol: float, max_iterations: int, time_limit_s: float | None
) -> Status:
    """Run a solver on a CVXPY problem and say how it ended; the values stay in the problem."""
    if solver == "scs":
        settings = {"eps_abs": tol, "eps_rel": tol, "max_iters": max_iterations}
    else:
        settings = {
            "tol_gap_abs": tol,
            "tol_gap_rel": tol,
            "tol_feas": tol,
            "max_iter": max_iterations,
        }
    if time_limit_s is not None and math.isfinite(time_limit_s):
        settings["time_limit_secs" if solver == "scs" else "time_limit"] = time_limit_s
    try:
        with warnings.catch_warnings():
            # The status says so.
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")
            program.solve(solver=solver.upper(), **settings)
    except cp.error.SolverError:
        return Status.FAILED
    except BaseException as error:
        # Clarabel panics on some ill-posed programs, outside the Exception hierarchy.
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
    return Status.ITERATION_LIMIT if (stats.num_iters or 0) >= max_iterations else Status.STALLED


def certify_model(model: CvxpyModel) -> Certificate:
    """Return the certificate of a solved model's dual variables, whose bound the verifier confirms.

    F of the optimum is singular, and that of an inexact solver is known up to its error. A shift by a multiple t of
    the identity makes it positive definite and costs t d for every source point. The bound is concave in t, so that
    one search finds the best shift.

    Parameters
    ----------
    model : CvxpyModel
        Solved.
    """
    data, (F, u, g, Y) = model.data, (values * model.scale for values in _dual_values(model))
    basis = MomentBasis(data.lifted.num_variables, data.lifted.equations)
    counts = np.diag((model.basis**2).sum(axis=0))
    size = float(np.abs(F).max(initial=0.0)) or 1.0

    def shifted(power: float) -> Certificate:
        moved = F + size * 10.0**power * counts
        y, _ = basis.split(basis.sum_of_points(data.lifted, moved, u, g, Y))
        return certify_dual(model.problem, data, F=moved, u=u, g=g, y=y, Y=Y)

    found = scipy.optimize.minimize_scalar(
        lambda power: -shifted(power).bound,
        bounds=_SHIFTS,
        method="bounded",
        options={"xatol": 0.05},
    )
    return shifted(float(found.x))


def _dual_values(model: CvxpyModel) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return F (k, s, s), u (k, s), g (n, s) and Y (q, 4, 4) of the scaled program, as certificates have them.

    Lagrange's function has ``2 <u_j, sum_i B_ij - rho>``, ``2 <g_i, sum_j B_ij - rho>`` and ``-<4 Y(R), Y / 4>``.
    """
    F = np.stack(
        [
            block.dual_value[own:, own:]
            for block, own in zip(
                model.blocks, np.bincount(model.source_index).tolist(), strict=True
            )
        ]
    )
    u = 0.5 * model.source_sums.dual_value.T
    g = np.zeros((model.problem.num_target, u.shape[1]))
    if model.row_sums is not None:
        g[summed_rows(model.data)] = 0.5 * model.row_sums.dual_value.T
    Y = np.zeros((len(model.hulls), 4, 4))
    for own, hull in zip(Y, model.hulls, strict=True):
        own[:] = 4.0 * hull.dual_value
    return F, u, g, Y
