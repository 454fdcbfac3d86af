"""The full lifted relaxation: one block of size 1 + n k + r, for small problems only.

Maron et al. 2016, eq. 9: with x = vec X and [R] stacked into one vector,

    [[1, x^T, [R]^T], [x, A, B^T], [[R], B, C]] PSD

with the same linear equations as PM-SDP. Entries of A between two *different* source points occur in no equation and
not in the objective; the graph of the others is chordal, so a partial matrix made of the blocks of PM-SDP can always
be completed and the two values are equal (Grone, Johnson, Sa, Wolkowicz 1984). This module keeps the large block, as
the check of that claim and as the baseline for times.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cvxpy as cp

from pairwise.pm_sdp.cvxpy_model import CvxpyModel, build_model
from pairwise.pm_sdp.cvxpy_solve import solve_model
from pairwise.problem import Problem
from pairwise.relaxations import SOLVERS
from pairwise.results import RelaxationResult


def solve_full_lifted(
    problem: Problem,
    *,
    solver: str = "clarabel",
    tol: float = 1e-6,
    time_limit_s: float | None = None,
    cross_products: bool = False,
    row_sums: bool = False,
) -> RelaxationResult:
    """Solve the full lifted relaxation through CVXPY.

    As published unless ``row_sums`` are asked for. Parameters and the result are those of
    :func:`pairwise.solve_relaxation`, but nothing is proven: ``lower_bound`` is NaN.
    Memory grows with (n k)^2 and time with a high power of it: n = k = 8 is comfortable.
    """
    model = lift_fully(build_model(problem, cross_products=cross_products, row_sums=row_sums))
    return solve_model(
        model,
        solver=solver,
        tol=tol,
        max_iterations=SOLVERS[solver][1],
        time_limit_s=time_limit_s,
    )


def lift_fully(model: CvxpyModel) -> CvxpyModel:
    """Return the model with the blocks of all source points replaced by the one large block."""
    num, s = len(model.source_index), len(model.basis.T)
    lifted = cp.Variable((1 + num + s, 1 + num + s), PSD=True)
    own: list[Any] = [lifted[0, 0] == 1.0]
    own.append(lifted[0, 1 : num + 1] == model.x)
    own.append(lifted[0, num + 1 :] == model.rho)
    own.append(lifted[num + 1 :, 1 : num + 1] == model.b)
    own.append(lifted[num + 1 :, num + 1 :] == model.c)
    for point in range(model.problem.num_source):
        columns = model.columns(point)
        block = slice(columns.start + 1, columns.stop + 1)
        own.append(lifted[block, block] == cp.diag(model.x[columns]))
    return replace(model, linear=[*model.linear, *own], blocks=[])
