"""The tight relaxation and its quaternion form in CVXPY: what the splitting method is tested against.

The formulation is that of :mod:`pairwise.tight.solve`, written down block by block over each chirality, for a
general conic solver. Slow and general on purpose: seconds for 20 points.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from pairwise.problem.problem import Problem
from pairwise.reference.cvxpy import cvxpy_module, solve_program
from pairwise.status import Status
from pairwise.tight.lift import make_lift
from pairwise.tight.problem import chiralities, lift_problem


def solve_tight_reference(
    problem: Problem,
    *,
    form: str = "tight",
    solver: str = "scs",
    tol: float = 1e-5,
    time_limit_s: float | None = None,
) -> tuple[float, Status]:
    """Solve the relaxation by a general solver and return its value and how it ended.

    Parameters
    ----------
    problem : Problem
        Dimension 2 or 3 and full R; over O(d) the lower of the two chiralities counts.
    form : {"tight", "quaternion"}
    solver : {"scs", "clarabel"}
    tol : float
        The solver's absolute and relative tolerance.
    time_limit_s : float, optional
        For each chirality, without CVXPY's set-up.

    Returns
    -------
    value : float
        NaN if the solver failed. It is no proven bound: the solver is inexact.
    status : Status
    """
    ends = [_solve_chirality(part, form, solver, tol, time_limit_s) for _, part in chiralities(problem)]
    value = float(np.min([value for value, _ in ends]))
    return value, next((status for _, status in ends if status is not Status.CONVERGED), Status.CONVERGED)


def _solve_chirality(
    problem: Problem, form: str, solver: str, tol: float, time_limit_s: float | None
) -> tuple[float, Status]:
    cp = cvxpy_module()
    lift = make_lift(form, problem.dim)
    blocks = lift_problem(problem, lift, problem.allowed)
    num, size = len(blocks.rows), lift.size
    nodes = np.concatenate([blocks.rows, blocks.cols + blocks.num_rows])
    edges = np.tile(np.arange(num), 2)
    members = csr_array((np.ones(2 * num), (edges, nodes)), shape=(num, len(blocks.counts)))
    x, mean = cp.Variable((len(lift.one), num)), cp.Variable((len(lift.one), 1))
    constraints = [x @ members == mean @ blocks.counts[None, :], lift.one @ mean == 1]
    constraints += [cp.reshape(lift.flat_basis @ x[:, b], (size, size), order="C") >> 0 for b in range(num)]
    scale = float(np.abs(blocks.costs).max()) or 1.0
    program = cp.Problem(cp.Minimize(cp.sum(cp.multiply(x, blocks.costs.T / scale))), constraints)
    status = solve_program(program, solver=solver, tol=tol, time_limit_s=time_limit_s)
    return (np.nan if status is Status.FAILED else scale * float(program.value)), status
