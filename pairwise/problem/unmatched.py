"""Problems in which source points may stay unmatched, at a cost: outliers, and sets that overlap in part.

Every source point gets a target of its own at the origin, which only this point can take and which costs the same in
every pose. So search, relaxation, branch and bound and certificates apply as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_tools.arrays import IntArray, read_only
from data_tools.checks import check_number
from data_tools.threads import one_blas_thread
from pairwise.problem.problem import Problem


@one_blas_thread()
def with_unmatched(problem: Problem, cost: float) -> Problem:
    """Return the problem in which each source point may stay unmatched.

    Its energy is ``sum_j w_j |R p_j - q_map(j)|^2 + c`` over the matched points, plus ``w_j cost`` for every other
    one: robust matching with truncated squares. Bounds and certificates of it are bounds of this energy.

    Parameters
    ----------
    problem : Problem
        n target points and k source points.
    cost : float
        In squared units of the points: a point whose match would be further away than its root stays unmatched.

    Returns
    -------
    Problem
        Of n + k target points. The last k are at the origin; ``map[j] = n + j`` says that point j is unmatched.

    Raises
    ------
    OptionsError
        If the cost is not positive.

    Examples
    --------
    >>> target = np.random.default_rng(0).random((8, 3))
    >>> source = np.vstack([target[:5], [[9.0, 9.0, 9.0]]])
    >>> robust = pairwise.with_unmatched(pairwise.Problem.from_user(target, source), cost=0.01)
    >>> round(robust.energy(np.eye(3), np.array([0, 1, 2, 3, 4, 13])), 6)
    0.01
    """
    check_number("unmatched_cost", cost, positive=True)
    k, d = problem.source.shape
    free = problem.weights * (cost - (problem.source**2).sum(axis=1))
    return replace(
        problem,
        target=read_only(np.concatenate([problem.target, np.zeros((k, d))])),
        allowed=read_only(np.concatenate([problem.allowed, np.eye(k, dtype=bool)])),
        constant_cost=read_only(np.concatenate([problem.constant_cost, np.diag(free)])),
    )


def marked_unmatched(point_map: IntArray, num_target: int) -> IntArray:
    """Return a map (k,) of a problem with unmatched points, -1 where one is unmatched."""
    return read_only(np.where(point_map < num_target, point_map, -1))
