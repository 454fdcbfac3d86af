"""Dual points of the tight relaxation: the bound that any multipliers prove, and the matches that it rules out.

For multipliers A_j of the source points, B_i of the target points and N_ij in the span of the lift's identities,
every rotation and injective map satisfy, with ``Z = z z^T`` and ``tr Z = tau``,

    E = sum_j <W_map(j)j - A_j - B_map(j) + N_map(j)j, Z> + <sum_j A_j + sum_i B_i, Z>
        + sum_(i unmatched) <N_i0 - B_i, Z>
      >= tau [ sum_i sigma_i0 + LAP(sigma_ij - sigma_i0) ] + min_Z <sum_j A_j + sum_i B_i, Z>

where sigma_ij is the smallest eigenvalue of the first matrix and sigma_i0 that of ``N_i0 - B_i`` (0 where k = n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray
from pairwise.tight.assignment_bounds import forced_bounds
from pairwise.tight.lift import Lift
from pairwise.tight.splitting import Blocks, Splitting

_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, kw_only=True, eq=False)
class DualStage:
    """Multipliers for one set of allowed matches, with what they prove.

    Attributes
    ----------
    lift : Lift
    allowed : ndarray of bool, shape (n, k)
        The matches that the stage speaks about.
    target_multipliers, source_multipliers : ndarray, shapes (n, m) and (k, m)
        B_i and A_j as coordinates in V.
    identity_multipliers : ndarray, shapes (b, c)
        N of every allowed match (row by row) and then, for k < n, of every "unmatched" block.
    bound : float
        No solution inside ``allowed`` costs less.
    forced : ndarray, shape (n, k)
        No solution inside ``allowed`` that uses the match costs less.
    """

    lift: Lift
    allowed: BoolArray
    target_multipliers: FloatArray
    source_multipliers: FloatArray
    identity_multipliers: FloatArray
    bound: float
    forced: FloatArray


def stage_of(splitting: Splitting, num_source: int) -> DualStage:
    """Read the dual variables off a splitting and evaluate what they prove.

    The multipliers of the sums are A and B; the part of the slack ``rho (S - v)`` outside V is N.
    """
    lift, blocks = splitting.lift, splitting.blocks
    n = blocks.num_rows
    multipliers = splitting.rho * splitting.multipliers
    target, source = multipliers[:n].copy(), multipliers[n:].copy()
    if blocks.num_cols > num_source:
        target += source[-1]
        source -= source[-1]
    slack = (splitting.rho * splitting.dual).reshape(len(blocks.rows), -1)
    identities = lift.identities.reshape(len(lift.identities), lift.size**2)
    outside = slack @ np.linalg.pinv(identities)
    return evaluate_stage(lift, blocks, num_source, target, source[:num_source], outside)


def single_map_stage(lift: Lift, blocks: Blocks, num_source: int) -> DualStage:
    """Return the exact dual of a problem with one candidate per source point: orthogonal Procrustes in closed form.

    Parameters
    ----------
    lift : Lift
        A quaternion lift: there ``sum_j W_j - lambda I`` with its smallest eigenvalue lambda proves the optimum.
    blocks : Blocks
        In that lift.
    num_source : int
    """
    matched = blocks.cols < num_source
    source = np.zeros((num_source, len(lift.basis)))
    source[blocks.cols[matched]] = blocks.costs[matched]
    total = source.sum(axis=0)
    smallest = float(np.linalg.eigvalsh((lift.flat_basis @ total).reshape(lift.size, lift.size))[0])
    source -= (total - smallest * lift.one) / num_source
    target = np.zeros((blocks.num_rows, len(lift.basis)))
    return evaluate_stage(lift, blocks, num_source, target, source, np.zeros((len(blocks.rows), 0)))


def evaluate_stage(
    lift: Lift,
    blocks: Blocks,
    num_source: int,
    target: FloatArray,
    source: FloatArray,
    identity_multipliers: FloatArray,
) -> DualStage:
    """Evaluate the bound of the module's docstring for given multipliers, less an allowance for rounding."""
    padded = np.vstack([source, np.zeros((blocks.num_cols - num_source, len(lift.one)))])
    coordinates = blocks.costs - target[blocks.rows] - padded[blocks.cols]
    corrections = identity_multipliers @ lift.identities.reshape(len(lift.identities), lift.size**2)
    slack = (coordinates @ lift.flat_basis.T + corrections).reshape(-1, lift.size, lift.size)
    sizes = np.linalg.norm(blocks.costs, axis=1) + np.linalg.norm(target, axis=1)[blocks.rows]
    sizes += np.linalg.norm(padded, axis=1)[blocks.cols] + np.linalg.norm(corrections, axis=1)
    smallest = np.linalg.eigvalsh(slack)[:, 0] - 64.0 * _EPS * lift.size * sizes

    matches = blocks.cols < num_source
    costs = np.full((blocks.num_rows, num_source), np.inf)
    costs[blocks.rows[matches], blocks.cols[matches]] = lift.trace * smallest[matches]
    unmatched = np.zeros(blocks.num_rows)
    unmatched[blocks.rows[~matches]] = lift.trace * smallest[~matches]
    assignment, forced = forced_bounds(costs - unmatched[:, None])

    total = target.sum(axis=0) + source.sum(axis=0)
    level = float(total @ lift.one / (lift.one @ lift.one))
    rest = float(np.linalg.norm(total - level * lift.one))
    rest += 64.0 * _EPS * float(np.linalg.norm(target) + np.linalg.norm(source)) * np.sqrt(len(target))
    base = level + float(unmatched.sum()) - lift.trace * rest
    return DualStage(
        lift=lift,
        allowed=np.isfinite(costs),
        target_multipliers=target,
        source_multipliers=source,
        identity_multipliers=np.vstack([identity_multipliers[matches], identity_multipliers[~matches]]),
        bound=base + assignment,
        forced=base + forced,
    )
