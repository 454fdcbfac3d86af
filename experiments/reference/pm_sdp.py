"""PM-SDP as the paper writes it, in CVXPY: the oracle that every faster solver is tested against.

Maron, Dym, Kezurer, Kovalsky, Lipman: Point registration via efficient convex relaxation (2016), eq. 10-12:

    minimise    sum_ij X_ij (w_j |q_i|^2 + c_ij) - 2 sum_ij w_j <v_ij, B_ij> + sum_j w_j |p_j|^2
    subject to  [[1, X_j^T, [R]^T], [X_j, diag(X_j), B_j^T], [[R], B_j, C]] PSD for every source point j
                X >= 0,  1^T X = 1,  X 1 = 1 (k = n) or X 1 <= 1 (k < n),  the identities of R as equations in C

``v_ij = [q_i p_j^T]``, so that ``q_i^T R p_j = <v_ij, [R]>``. Because ``1^T X_j = 1``, the vector (1, -1, 0) lies in
the kernel of the lifted matrix, so its leading row and column are dropped without loss:

    [[diag(X_j), B_j^T], [B_j, C]] PSD   and   B_j 1 = [R].

The paper leaves out one more set of linear equations that every pose satisfies: a target point that is always matched
has ``sum_j B_j[:, i] = [R]``. They are part of the relaxation unless it is asked for as published.

Only allowed matches get variables. Slow (seconds for 20 points) and general on purpose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cvxpy as cp
import numpy as np
from scipy.sparse import coo_array, csr_array

from data_tools.arrays import FloatArray, IntArray, read_only
from experiments.reference.constraints import (
    cross_product_equations,
    hull_constraints,
    orthogonality_equations,
    solve_program,
)
from pairwise.problem import Problem, assignment_support
from pairwise.results import RelaxationResult, Status


@dataclass(frozen=True, eq=False)
class Model:
    """The variables of PM-SDP in CVXPY, with its constraints and its objective.

    Attributes
    ----------
    problem : Problem
    target_index, source_index : ndarray of int, shape (m,)
        The candidate matches (i, j), grouped by j; m of them.
    x : cvxpy expression, shape (m,)
        X_ij of each candidate.
    b : cvxpy expression, shape (r, m)
        B_ij of each candidate.
    c : cvxpy expression, shape (r, r)
    entries : cvxpy expression, shape (r,)
        [R].
    objective : cvxpy expression
        The energy divided by ``scale``, without its constant.
    scale, constant : float
        ``scale * objective + constant`` is the relaxed energy.
    linear, blocks : lists of cvxpy constraints
        The linear equations and the hull of R; the semidefinite block of every source point.
    """

    problem: Problem
    target_index: IntArray
    source_index: IntArray
    x: Any
    b: Any
    c: Any
    entries: Any
    objective: Any
    scale: float
    constant: float
    linear: list[Any]
    blocks: list[Any]

    def columns(self, source_point: int) -> slice:
        """Return where the allowed matches of a source point lie among all of them."""
        start, stop = np.searchsorted(self.source_index, [source_point, source_point + 1])
        return slice(int(start), int(stop))


def solve_reference(
    problem: Problem,
    *,
    solver: str = "clarabel",
    tol: float = 1e-6,
    max_iterations: int | None = None,
    time_limit_s: float | None = None,
    cross_products: bool = False,
    row_sums: bool = True,
) -> RelaxationResult:
    """Solve PM-SDP through CVXPY.

    Parameters
    ----------
    problem : Problem
        Any variant: k <= n, candidate masks, patterns of R, rotation blocks, weights, constant costs.
    solver : {"clarabel", "scs"}
        Clarabel is an interior-point method (accurate, up to about 20 points), SCS a first-order method.
    tol : float
        The solver's absolute and relative tolerance.
    max_iterations : int, optional
        200 for Clarabel and 100 000 for SCS by default.
    time_limit_s : float, optional
        Seconds for the solver itself, without CVXPY's set-up.
    cross_products : bool
        Use the cross-product identities of rotation blocks of size 3 (stronger) instead of the convex hull of SO(3).
    row_sums : bool
        Use the equations of target points that are always matched (stronger); False is PM-SDP as published.

    Returns
    -------
    RelaxationResult
        ``lower_bound`` is NaN: the value of an inexact solver proves nothing. On failure all numbers are NaN.

    Raises
    ------
    OptionsError
        If the solver is unknown, ``tol`` or a limit is not positive, or source points may stay unmatched.
    """
    return solve_model(
        build_model(problem, cross_products=cross_products, row_sums=row_sums),
        solver=solver,
        tol=tol,
        max_iterations=max_iterations,
        time_limit_s=time_limit_s,
    )


def build_model(problem: Problem, *, cross_products: bool = False, row_sums: bool = True) -> Model:
    """Write PM-SDP of a problem in CVXPY, in the reduced form of the module's docstring."""
    j, i = np.nonzero(problem.allowed.T)
    r, m = problem.pattern.num_entries, len(i)
    x, b = cp.Variable(m, nonneg=True), cp.Variable((r, m))
    c, entries = cp.Variable((r, r), symmetric=True), cp.Variable(r)
    objective, scale, constant = _objective(problem, i, j, x, b)
    model = Model(problem, i, j, x, b, c, entries, objective, scale, constant, [], [])
    by_source = _incidence(j, problem.num_source)
    model.linear.extend(
        [
            *matching_constraints(problem, i, j, x),
            _sums_to(b @ by_source.T, entries),
            *rotation_constraints(problem, c, entries, cross_products=cross_products),
        ]
    )
    always_full = assignment_support(problem.allowed)[1]
    if row_sums and always_full.any():
        model.linear.append(_sums_to(b @ _incidence(i, problem.num_target)[always_full].T, entries))
    for point in range(problem.num_source):
        own = model.columns(point)
        model.blocks.append(cp.bmat([[cp.diag(x[own]), b[:, own].T], [b[:, own], c]]) >> 0)
    return model


def _sums_to(sums: Any, entries: Any) -> Any:
    """Return the constraint that every column of an (r, m) expression is [R], shape (r,)."""
    columns = cp.reshape(entries, (entries.size, 1), order="F")
    return sums == columns @ np.ones((1, sums.shape[1]))


def matching_constraints(problem: Problem, i: IntArray, j: IntArray, x: Any) -> list[Any]:
    """Return ``1^T X = 1`` and ``X 1 = 1`` (k = n) or ``X 1 <= 1`` (k < n) over the allowed (i, j)."""
    sums = _incidence(i, problem.num_target) @ x
    rows = sums == 1.0 if problem.num_source == problem.num_target else sums <= 1.0
    return [_incidence(j, problem.num_source) @ x == 1.0, rows]


def rotation_constraints(
    problem: Problem, c: Any, entries: Any, *, cross_products: bool
) -> list[Any]:
    """Return orthogonality of the lifted R, and its hull or its cross products for rotation blocks."""
    pattern = problem.pattern
    lifted = [orthogonality_equations(pattern)]
    blocks = pattern.special_blocks
    if cross_products:
        lifted.append(cross_product_equations(pattern))
        kept = tuple(block for block in blocks if block[1] - block[0] != 3)
        pattern = replace(pattern, special_blocks=kept)
    equations = [
        quadratic @ cp.vec(c, order="F") + linear @ entries == constant
        for quadratic, linear, constant in lifted
        if len(constant)
    ]
    return [*equations, *hull_constraints(pattern, entries)]


def solve_model(
    model: Model,
    *,
    solver: str,
    tol: float,
    max_iterations: int | None = None,
    time_limit_s: float | None = None,
) -> RelaxationResult:
    """Solve a model built by :func:`build_model`; see :func:`solve_reference`."""
    program = cp.Problem(cp.Minimize(model.objective), [*model.linear, *model.blocks])
    status = solve_program(
        program, solver=solver, tol=tol, max_iterations=max_iterations, time_limit_s=time_limit_s
    )
    if status is Status.FAILED or model.x.value is None:
        return _failed(model, status)
    x, b, c, r_entries = (
        np.asarray(v.value, dtype=float) for v in (model.x, model.b, model.c, model.entries)
    )
    problem = model.problem
    matches = np.zeros((problem.num_target, problem.num_source))
    matches[model.target_index, model.source_index] = x
    lifted = np.zeros((problem.num_source, len(r_entries), problem.num_target))
    lifted[model.source_index, :, model.target_index] = b.T
    value = float(model.objective.value) * model.scale + model.constant
    return RelaxationResult(
        value=value,
        lower_bound=math.nan,
        R=read_only(problem.pattern.unpack(r_entries)),
        X=read_only(matches),
        C=read_only(0.5 * (c + c.T)),
        B=read_only(lifted),
        status=status,
    )


def _objective(
    problem: Problem, i: IntArray, j: IntArray, x: Any, b: Any
) -> tuple[Any, float, float]:
    """Return the linear energy of the allowed matches divided by a scale, that scale, and the constant."""
    weights = problem.weights
    linear = weights[j] * (problem.target[i] ** 2).sum(axis=1) + problem.constant_cost[i, j]
    rows, cols = problem.pattern.entries
    v = weights[j] * problem.target[i][:, rows].T * problem.source[j][:, cols].T
    constant = float(weights @ (problem.source**2).sum(axis=1))
    scale = max(float(np.abs(linear).max()), 2.0 * float(np.abs(v).max())) or 1.0
    return (linear / scale) @ x - cp.sum(cp.multiply(2.0 * v / scale, b)), scale, constant


def _incidence(labels: IntArray, num: int) -> csr_array:
    """Return the (num, m) matrix that sums matches with the same label."""
    return coo_array(
        (np.ones(len(labels)), (labels, np.arange(len(labels)))), shape=(num, len(labels))
    ).tocsr()


def _failed(model: Model, status: Status) -> RelaxationResult:
    problem = model.problem
    n, k, d, r = problem.num_target, problem.num_source, problem.dim, problem.pattern.num_entries

    def missing(*shape: int) -> FloatArray:
        return read_only(np.full(shape, np.nan))

    return RelaxationResult(
        value=math.nan,
        lower_bound=math.nan,
        R=missing(d, d),
        X=missing(n, k),
        C=missing(r, r),
        B=missing(k, r, n),
        status=status,
    )
