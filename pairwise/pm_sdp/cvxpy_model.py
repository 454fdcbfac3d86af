"""PM-SDP as the paper writes it, in CVXPY.

Maron, Dym, Kezurer, Kovalsky, Lipman: Point registration via efficient convex relaxation (2016), eq. 10-12:

    minimise    sum_ij X_ij (w_j |q_i|^2 + c_ij) - 2 sum_ij w_j <v_ij, B_ij> + sum_j w_j |p_j|^2
    subject to  [[1, X_j^T, [R]^T], [X_j, diag(X_j), B_j^T], [[R], B_j, C]] PSD for every source point j
                X >= 0,  1^T X = 1,  X 1 = 1 (k = n) or X 1 <= 1 (k < n),  the identities of R as equations in C

``v_ij = [q_i p_j^T]``, so that ``q_i^T R p_j = <v_ij, [R]>``. Because ``1^T X_j = 1``, the vector (1, -1, 0) lies in
the kernel of the lifted matrix, so its leading row and column are dropped without loss:

    [[diag(X_j), B_j^T], [B_j, C]] PSD   and   B_j 1 = [R].

The paper leaves out one more set of linear equations that every pose satisfies: a target point that is always matched
has ``sum_j B_j[:, i] = [R]``. They are part of the relaxation unless it is asked for as published.

Two things give the cones an interior, without which solvers stall. Only matches that some assignment uses get
variables. And entries of R that are equal in every rotation share one: ``[R] = basis @ rho``, so that the program's B
and C are those of rho.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cvxpy as cp
import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.lifted_rotation import LiftedRotation
from pairwise.problem import Problem


@dataclass(frozen=True, kw_only=True, eq=False)
class CvxpyModel:
    """The variables of PM-SDP in CVXPY, with its constraints and its objective.

    Attributes
    ----------
    problem : Problem
    data : RelaxationData
        Of the built-in solver: which matches are possible, which rows are tied, what rho is.
    target_index, source_index : ndarray of int, shape (m,)
        The possible matches (i, j), grouped by j; m of them.
    x : cvxpy expression, shape (m,)
        X_ij of each match.
    b : cvxpy expression, shape (s, m)
        B_ij of each match.
    c : cvxpy expression, shape (s, s)
    rho : cvxpy expression, shape (s,)
    objective : cvxpy expression
        The energy divided by ``scale``, without its constant.
    scale, constant : float
        ``scale * objective + constant`` is the relaxed energy.
    linear : list of cvxpy constraints
        Of the assignment, and of the moments of R (eq. 8).
    hulls : list of cvxpy constraints
        The quaternion moments of each 3 x 3 rotation block are PSD.
    blocks : list of cvxpy constraints
        The lifted matrix of each source point, without its leading row and column, is PSD.
    source_sums, row_sums : cvxpy constraint
        ``sum_i B_ij = rho`` of every source point, shape (s, k); ``sum_j B_ij = rho`` of the target points of
        ``summed_rows``, None without any.
    """

    problem: Problem
    data: RelaxationData
    target_index: IntArray
    source_index: IntArray
    x: Any
    b: Any
    c: Any
    rho: Any
    objective: Any
    scale: float
    constant: float
    linear: list[Any]
    hulls: list[Any]
    blocks: list[Any]
    source_sums: Any
    row_sums: Any

    @property
    def basis(self) -> FloatArray:
        """``[R] = basis @ rho``, shape (r, s)."""
        return self.data.lifted.basis[:, 1:]

    @property
    def program(self) -> Any:
        """The CVXPY problem."""
        sums = [self.source_sums] if self.row_sums is None else [self.source_sums, self.row_sums]
        constraints = [*self.linear, *self.hulls, *sums, *self.blocks]
        return cp.Problem(cp.Minimize(self.objective), constraints)

    def columns(self, source_point: int) -> slice:
        """Return where the matches of a source point lie among all of them."""
        start, stop = np.searchsorted(self.source_index, [source_point, source_point + 1])
        return slice(int(start), int(stop))


def build_model(
    problem: Problem, *, cross_products: bool = False, row_sums: bool = True
) -> CvxpyModel:
    """Write PM-SDP of a problem in CVXPY, in the reduced form of the module's docstring.

    Parameters
    ----------
    problem : Problem
    cross_products, row_sums
        See :func:`pairwise.solve_relaxation`.
    """
    data = RelaxationData.from_problem(problem, cross_products=cross_products, row_sums=row_sums)
    j, slot = np.nonzero(data.valid)
    i = data.index[j, slot]
    s, m = data.lifted.num_variables, len(i)
    x, b = cp.Variable(m, nonneg=True), cp.Variable((s, m))
    c, rho = cp.Variable((s, s), symmetric=True), cp.Variable(s)
    costs, vectors = data.cost[j, slot], data.vectors[j, slot].T
    scale = max(float(np.abs(costs).max()), 2.0 * float(np.abs(vectors).max())) or 1.0
    moments, hulls = rotation_constraints(data.lifted, c, rho)
    tied = _incidence(i, problem.num_target)[summed_rows(data)]
    model = CvxpyModel(
        problem=problem,
        data=data,
        target_index=i,
        source_index=j,
        x=x,
        b=b,
        c=c,
        rho=rho,
        objective=(costs / scale) @ x - cp.sum(cp.multiply(2.0 * vectors / scale, b)),
        scale=scale,
        constant=data.constant,
        linear=[*matching_constraints(problem, i, j, x), moments],
        hulls=hulls,
        blocks=[],
        source_sums=_sums_to(b @ _incidence(j, problem.num_source).T, rho),
        row_sums=_sums_to(b @ tied.T, rho) if tied.shape[0] else None,
    )
    for point in range(problem.num_source):
        own = model.columns(point)
        model.blocks.append(cp.bmat([[cp.diag(x[own]), b[:, own].T], [b[:, own], c]]) >> 0)
    return model


def summed_rows(data: RelaxationData) -> BoolArray:
    """Return the tied rows (n,) whose sums of B are equations of their own: those of the pinned rows follow."""
    return data.tied & ~data.pinned


def _sums_to(sums: Any, rho: Any) -> Any:
    """Return the constraint that every column of an (s, m) expression is rho, shape (s,)."""
    columns = cp.reshape(rho, (rho.size, 1), order="F")
    return sums == columns @ np.ones((1, sums.shape[1]))


def matching_constraints(problem: Problem, i: IntArray, j: IntArray, x: Any) -> list[Any]:
    """Return ``1^T X = 1`` and ``X 1 = 1`` (k = n) or ``X 1 <= 1`` (k < n) over the possible matches (i, j)."""
    sums = _incidence(i, problem.num_target) @ x
    rows = sums == 1.0 if problem.num_source == problem.num_target else sums <= 1.0
    return [_incidence(j, problem.num_source) @ x == 1.0, rows]


def rotation_constraints(lifted: LiftedRotation, c: Any, rho: Any) -> tuple[Any, list[Any]]:
    """Return the equations of the moments of R, and that each hull's ``4 Y(R)`` is PSD."""
    forms = lifted.equations
    quadratic, linear = forms[:, 1:, 1:].reshape(len(forms), -1), 2.0 * forms[:, 0, 1:]
    moments = quadratic @ cp.vec(c, order="F") + linear @ rho == -forms[:, 0, 0]
    slopes = 4.0 * lifted.quaternion_slopes.reshape(-1, lifted.num_variables, 16)
    hulls = [np.eye(4) + cp.reshape(rho @ own, (4, 4), order="C") >> 0 for own in slopes]
    return moments, hulls


def _incidence(labels: IntArray, num: int) -> scipy.sparse.csr_array:
    """Return the (num, m) matrix that sums matches with the same label."""
    return scipy.sparse.coo_array(
        (np.ones(len(labels)), (labels, np.arange(len(labels)))), shape=(num, len(labels))
    ).tocsr()
