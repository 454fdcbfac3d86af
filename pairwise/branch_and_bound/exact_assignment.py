"""One-to-one matches of least cost, of many similar matrices: each starts from potentials of the one before.

For costs c_ji of k rows and n columns and potentials v of the columns, a row is content with its least c_ji - v_i.
Rows that are content with different columns are matched at once. Each other one is matched along a shortest
augmenting path (Jonker and Volgenant 1987), which changes the potentials.

Compiled by Numba: SciPy's solver starts every problem from nothing and returns no potentials. For 64 points it takes
2.5 times as long for the first pose of a descent, and 3 times for the next ones.
"""

from __future__ import annotations

import numba
import numpy as np

from data_tools.arrays import FloatArray, IntArray


@numba.njit(cache=True)
def cheapest_matches(costs: FloatArray, potentials: FloatArray, maps: IntArray) -> None:
    """Write the best match of every row, of many matrices of which each has a match of finite cost.

    Parameters
    ----------
    costs : ndarray, shape (m, k, n)
        ``inf`` where a row must not go to a column; k <= n.
    potentials : ndarray, shape (m, n)
        Of the columns. Where k = n each problem starts from them; what shows that its match is best is written there.
    maps : ndarray of int, shape (m, k)
        Gets the column of each row.
    """
    num, k, size = costs.shape
    reduced, slack, least = np.empty(size), np.empty(size), np.empty(k)
    row_of, waiting = np.empty(size, dtype=np.int64), np.empty(k, dtype=np.int64)
    for c in range(num):
        rows, v = costs[c], potentials[c]
        if k == size:
            slack[:] = np.inf
            for j in range(k):
                least[j] = reduce_row(rows[j], v, reduced)
                _keep_least(slack, reduced, least[j])
            v += slack
        else:  # columns that stay free keep potential zero
            v[:] = 0.0
        row_of[:] = -1
        num_waiting = 0
        for j in range(k):
            best = position(reduced, reduce_row(rows[j], v, reduced))
            if row_of[best] < 0:
                row_of[best] = j
            else:
                waiting[num_waiting] = j
                num_waiting += 1
        for row in waiting[:num_waiting]:
            augment(rows, v, row_of, row)
        for i in range(size):
            if row_of[i] >= 0:
                maps[c, row_of[i]] = i


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def _keep_least(slack: FloatArray, reduced: FloatArray, least: float) -> None:
    """Lower each slack to that of one row, whose reduced costs and least one are given."""
    for i in range(len(slack)):
        own = reduced[i] - least
        slack[i] = own if own < slack[i] else slack[i]


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def reduce_row(costs: FloatArray, v: FloatArray, out: FloatArray) -> float:
    """Write ``costs - v`` and return the least entry."""
    least = np.inf
    for i in range(len(v)):
        reduced = costs[i] - v[i]
        out[i] = reduced
        least = reduced if reduced < least else least
    return least


@numba.njit(cache=True)
def position(values: FloatArray, wanted: float) -> int:
    """Return where a value that occurs is found first."""
    for i in range(len(values)):
        if values[i] == wanted:
            return i
    return 0


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def _relax(
    costs: FloatArray,
    masked: FloatArray,
    offset: float,
    row: int,
    distances: FloatArray,
    parents: IntArray,
) -> float:
    """Shorten the distances by paths through one row; return the least."""
    least = np.inf
    for i in range(len(masked)):
        distance = costs[i] - masked[i] + offset
        old = distances[i]
        parents[i] = row if distance < old else parents[i]
        shorter = distance if distance < old else old
        distances[i] = shorter
        least = shorter if shorter < least else least
    return least


@numba.njit(cache=True)
def augment(costs: FloatArray, v: FloatArray, row_of: IntArray, start: int) -> float:
    """Match one more row along a shortest augmenting path; return by how much the bound rises.

    Parameters
    ----------
    costs : ndarray, shape (r, n)
        The last row stands for all rows from it on.
    v : ndarray, shape (n,)
        Potentials of the columns, which change.
    row_of : ndarray of int, shape (n,)
        The row of each column, -1 of those that are free, which changes.
    start : int
        The row.
    """
    last, size = len(costs) - 1, len(v)
    distances, parents, masked = np.full(size, np.inf), np.empty(size, dtype=np.int64), v.copy()
    finals, done = np.empty(size), np.empty(size, dtype=np.int64)
    row, offset, num, first = start, 0.0, 0, 0.0
    while True:
        length = _relax(costs[min(row, last)], masked, offset, row, distances, parents)
        col = position(distances, length)
        first = first if num else length
        if row_of[col] < 0:
            break
        finals[num], done[num] = length, col
        num += 1
        masked[col], distances[col] = -np.inf, np.inf
        row = row_of[col]
        offset = length - (costs[min(row, last), col] - v[col])
    for p in range(num):
        v[done[p]] += finals[p] - length
    while True:
        row = parents[col]
        held = position(row_of, row)
        row_of[col] = row
        if row == start:
            return length - first
        col = held
