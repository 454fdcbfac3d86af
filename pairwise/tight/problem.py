"""The tight relaxation of a checked problem: chirality, blocks and scale, before any iteration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_tools.arrays import BoolArray, FloatArray
from data_tools.errors import OptionsError
from pairwise.problem.pattern import RotationPattern
from pairwise.problem.problem import Problem
from pairwise.tight.lift import Lift
from pairwise.tight.splitting import Blocks


def mirror(dim: int) -> FloatArray:
    """Return the reflection F, diagonal (d,), such that every reflection is a rotation times F: -I in odd d."""
    signs = -np.ones(dim)
    if dim % 2 == 0:
        signs[:-1] = 1.0
    return signs


def chiralities(problem: Problem, *, partial: bool = False) -> list[tuple[bool, Problem]]:
    """Split a problem over SO(d) or O(d) into problems over SO(d), ``(reflected, problem)``.

    The source of the reflected one is ``source * mirror(d)``, so that its R stands for ``R diag(mirror)``.

    Raises
    ------
    OptionsError
        If R has zeros, more than one rotation block or a dimension other than 2 and 3, or for partial matching unless
        that is ``partial``.
    """
    pattern, dim = problem.pattern, problem.dim
    if dim not in (2, 3) or not pattern.mask.all() or pattern.special_blocks not in ((), ((0, dim),)):
        raise OptionsError("this needs points in dimension 2 or 3 and a full matrix R in SO(d) or O(d)")
    if problem.max_unmatched and not partial:
        raise OptionsError("this does not handle partial matching (num_matches, unmatched_penalty)")
    proper = replace(problem, pattern=RotationPattern(pattern.mask, ((0, dim),)))
    if pattern.special_blocks:
        return [(False, proper)]
    return [(False, proper), (True, replace(proper, source=problem.source * mirror(dim)))]


def lift_problem(problem: Problem, lift: Lift, allowed: BoolArray) -> Blocks:
    """Write the costs ``w_j |R p_j - q_i|^2 + c_ij`` of the allowed matches (n, k) as functionals of the lift.

    Blocks come row by row; for k < n one "unmatched" block of zero cost per target point follows.
    """
    n, k = problem.num_target, problem.num_source
    rows, cols = np.nonzero(allowed)
    q, p, weights = problem.target[rows], problem.source[cols], problem.weights[cols]
    constants = weights * ((q**2).sum(axis=1) + (p**2).sum(axis=1)) + problem.constant_cost[rows, cols]
    slopes = -2.0 * weights[:, None, None] * q[:, :, None] * p[:, None, :]
    costs = lift.cost_coordinates(constants, slopes)
    if k < n:
        rows, cols = np.append(rows, np.arange(n)), np.append(cols, np.full(n, k))
        costs = np.vstack([costs, np.zeros((n, costs.shape[1]))])
    return Blocks(rows=rows, cols=cols, costs=costs, num_rows=n, num_cols=k + (k < n))


def energy_scale(problem: Problem) -> float:
    """Return a typical size of the energy, for absolute tolerances: the spread of both shapes about the origin."""
    weight = float(problem.weights.sum())
    squares = float((problem.weights * (problem.source**2).sum(axis=1)).sum())
    constant = float(np.abs(problem.constant_cost).mean(axis=0).sum())
    return squares + weight * float((problem.target**2).sum(axis=1).mean()) + constant


def penalty(blocks: Blocks, lift: Lift) -> float:
    """Return the splitting's rho for these costs: a quarter of |W less its mean| / |S|, and 1 where all are zero.

    The first norm estimates the dual slack, the second is that of the solution where the map is certain.
    """
    spread = float(np.linalg.norm(blocks.costs - blocks.costs.mean(axis=0)))
    largest = float(np.linalg.norm(blocks.costs))
    return 0.25 * max(spread, 1e-3 * largest) / (lift.trace * np.sqrt(blocks.num_rows)) or 1.0
