"""Lower bounds of assignment problems, free and forced to use one match, that hold in spite of rounding."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import FloatArray, IntArray

_EPS = float(np.finfo(np.float64).eps)


def forced_bounds(costs: FloatArray) -> tuple[float, FloatArray]:
    """Bound the cheapest injective assignment of columns to rows, and the cheapest one that uses each match.

    Dual potentials of the optimal assignment prove the first; the second adds the cheapest alternating path by which
    the other columns make room (reduced-cost fixing). Both are less an allowance for rounding.

    Parameters
    ----------
    costs : ndarray, shape (n, k)
        ``inf`` where a match is not allowed; k <= n and some injective assignment is allowed.

    Returns
    -------
    bound : float
    forced : ndarray, shape (n, k)
        ``inf`` where a match is not allowed or no assignment uses it.
    """
    n, k = costs.shape
    rows, cols = linear_sum_assignment(costs)
    owner = np.empty(k, dtype=np.int64)
    owner[cols] = rows
    matched = costs[owner, np.arange(k)]
    moves = _alternating_paths(costs - matched, owner)
    potentials = np.minimum(moves.min(axis=0), 0.0)
    columns = (costs - potentials[:, None]).min(axis=0)
    terms = np.concatenate([columns, potentials])
    bound = float(terms.sum()) - 2.0 * _EPS * (n + k) * float(np.abs(terms).sum())
    free = np.setdiff1d(np.arange(n), owner)
    to_free = moves[:, free].min(axis=1, initial=np.inf)
    room = np.minimum(moves[:, owner], to_free[:, None] + potentials[owner])
    largest = float(np.abs(costs[np.isfinite(costs)]).max())
    forced = bound + np.maximum(costs - matched + room - 8.0 * _EPS * n * n * largest, 0.0)
    return bound, forced


def _alternating_paths(changes: FloatArray, owner: IntArray) -> FloatArray:
    """Return what it costs at least that the holder of row a leaves it and, move by move, row b is taken, (n, n).

    ``changes[i, j]`` is what it costs that column j moves to row i (Floyd and Warshall over the rows).
    """
    n = len(changes)
    moves = np.full((n, n), np.inf)
    moves[owner] = changes.T
    np.fill_diagonal(moves, 0.0)
    for via in owner:
        np.minimum(moves, moves[:, via, None] + moves[via], out=moves)
    return moves
