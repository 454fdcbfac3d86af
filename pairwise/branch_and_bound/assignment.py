"""Lower bounds of many assignment problems, each started from potentials that were good for a similar one.

For costs c_ji of k rows and N columns and any potentials v of the columns (at most 0 where k < N) weak duality gives

    min over injective maps of sum_j c_j,map(j)  >=  sum_j min_i (c_ji - v_i) + sum_i v_i,

written for N - k more rows of zero costs, so that v needs no sign. An auction (Bertsekas 1988) raises the right-hand
side from the given potentials by N bids, each a step beyond the second choice, so that it stays within N steps of
the optimum. It ends as soon as the bound exceeds what is asked for, or an assignment shows that it cannot; what is
contested is left to shortest augmenting paths (Jonker and Volgenant 1987). What is returned is the right-hand side
above, evaluated again from the final potentials: valid however they were found.

Compiled by Numba: SciPy's solver starts every problem from nothing, returns no potentials, and cannot stop early.
"""

from __future__ import annotations

import numba
import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray

_EPS = float(np.finfo(np.float64).eps)


@numba.njit(cache=True)
def bound_assignments(
    fixed: FloatArray,
    source: FloatArray,
    target: FloatArray,
    turns: FloatArray,
    potentials: FloatArray,
    starts: IntArray,
    wanted: FloatArray,
    steps: FloatArray,
    optimism: FloatArray,
) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
    """Bound the assignments of costs ``fixed[j, i] + <q_i, T p_j>`` for many 3 x 3 matrices T.

    Parameters
    ----------
    fixed : ndarray, shape (k, N)
        ``inf`` where j must not go to i.
    source : ndarray, shape (k, 3)
        p_j, with every factor that the costs have.
    target : ndarray, shape (3, N)
        Coordinates of q_i.
    turns : ndarray, shape (m, 3, 3)
    potentials : ndarray, shape (t, N)
    starts : ndarray of int, shape (m,)
        Which of the potentials each problem starts from.
    wanted, steps : ndarray, shape (m,)
        Stop when the bound exceeds this, or is within N steps of the optimum.
    optimism : ndarray, shape (m,)
        Stop when not even this share of the way from the bound to the cost of some assignment exceeds what is wanted;
        1 is sure not to stop too early.

    Returns
    -------
    bounds : ndarray, shape (m,)
        Lower bounds of the least costs, the rounding of their sums accounted for.
    energies : ndarray, shape (m,)
        Cost of some assignment where the bound is not what was wanted, else ``inf``.
    is_improved : ndarray of bool, shape (m,)
        Whether the given potentials were not enough.
    improved : ndarray, shape (m, N)
        The potentials that prove each bound.
    """
    k, size = fixed.shape
    num = len(turns)
    bounds, energies = np.empty(num), np.full(num, np.inf)
    improved, is_improved = np.empty((num, size)), np.zeros(num, dtype=np.bool_)
    costs = np.zeros((k + 1, size))
    for c in range(num):
        _fill(costs, fixed, source, target, turns[c])
        v = improved[c]
        v[:] = potentials[starts[c]]
        bounds[c] = _dual_value(costs, v)
        if bounds[c] <= wanted[c]:
            energies[c] = _solve(costs, v, wanted[c], steps[c], optimism[c])
            after = _dual_value(costs, v)
            is_improved[c] = after > bounds[c]
            if is_improved[c]:
                bounds[c] = after
            else:
                v[:] = potentials[starts[c]]
    return bounds, energies, is_improved, improved


@numba.njit(cache=True)
def _fill(costs: FloatArray, fixed: FloatArray, source: FloatArray, target: FloatArray, turn: FloatArray) -> None:
    """Write the costs of one problem into all but the last row."""
    moved = np.empty(3)
    for j in range(len(fixed)):
        for a in range(3):
            moved[a] = 0.0
            for b in range(3):
                moved[a] += turn[a, b] * source[j, b]
        x, y, z = moved
        for i in range(fixed.shape[1]):
            along = x * target[0, i] + y * target[1, i] + z * target[2, i]
            costs[j, i] = fixed[j, i] + along


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def _least(costs: FloatArray, v: FloatArray) -> float:
    least = np.inf
    for i in range(len(v)):
        reduced = costs[i] - v[i]
        least = reduced if reduced < least else least
    return least


@numba.njit(cache=True)
def _dual_value(costs: FloatArray, v: FloatArray) -> float:
    """Return ``sum_j min_i (c_ji - v_i) + sum_i v_i`` over all N rows, less what its additions may have lost."""
    k, size = len(costs) - 1, len(v)
    total, sizes = 0.0, 0.0
    for j in range(k):
        least = _least(costs[j], v)
        total += least
        sizes += abs(least)
    if size > k:
        least = _least(costs[k], v)
        total += (size - k) * least
        sizes += (size - k) * abs(least)
    for i in range(size):
        total += v[i]
        sizes += abs(v[i])
    return total - _EPS * (2 * size + 4) * sizes


@numba.njit(cache=True)
def _solve(costs: FloatArray, v: FloatArray, wanted: float, step: float, optimism: float) -> float:
    """Improve potentials in place; return the cost of an assignment, ``inf`` where the bound exceeds ``wanted``."""
    size = len(v)
    row_of = np.full(size, -1)
    free = _take_tight(costs, v, row_of)
    free = _bid(costs, v, row_of, free, step)
    value = _dual_value(costs, v)
    if value > wanted:
        return np.inf
    energy = _greedy_value(costs, v, row_of, free)
    if not len(free) or value + optimism * (energy - value) <= wanted:
        return energy
    distances, parents = np.empty(size), np.empty(size, dtype=np.int64)
    masked, finals, done = np.empty(size), np.empty(size), np.empty(size, dtype=np.int64)
    for row in free:
        value += _augment(costs, v, row_of, row, distances, parents, masked, finals, done)
        if value > wanted:
            return np.inf
    return _greedy_value(costs, v, row_of, free[:0])


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def _reduced(costs: FloatArray, v: FloatArray, out: FloatArray) -> float:
    """Write ``costs - v`` and return the least entry."""
    least = np.inf
    for i in range(len(v)):
        reduced = costs[i] - v[i]
        out[i] = reduced
        least = reduced if reduced < least else least
    return least


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def _minimum(values: FloatArray) -> float:
    least = np.inf
    for i in range(len(values)):
        least = values[i] if values[i] < least else least
    return least


@numba.njit(cache=True)
def _position(values: FloatArray, wanted: float) -> int:
    """Return where a value that occurs is found first."""
    for i in range(len(values)):
        if values[i] == wanted:
            return i
    return 0


@numba.njit(cache=True)
def _take_tight(costs: FloatArray, v: FloatArray, row_of: IntArray) -> IntArray:
    """Give every row its cheapest column while that is free, rows of zeros any of theirs; return the others."""
    k, size = len(costs) - 1, len(v)
    free, num, reduced = np.empty(size, dtype=np.int64), 0, np.empty(size)
    for j in range(k):
        best = _position(reduced, _reduced(costs[j], v, reduced))
        if row_of[best] < 0:
            row_of[best] = j
        else:
            free[num] = j
            num += 1
    top, j = v.max(), k
    for i in range(size):
        if j < size and row_of[i] < 0 and v[i] == top:
            row_of[i] = j
            j += 1
    for rest in range(j, size):
        free[num] = rest
        num += 1
    return free[:num]


@numba.njit(cache=True)
def _greedy_value(costs: FloatArray, v: FloatArray, row_of: IntArray, free: IntArray) -> float:
    """Return what it costs if every free row takes the cheapest column that others leave it; ``inf`` if none is."""
    k, size = len(costs) - 1, len(v)
    total, reduced, left = 0.0, np.empty(size), v.copy()
    for i in range(size):
        if row_of[i] >= 0:
            left[i] = -np.inf
            if row_of[i] < k:
                total += costs[row_of[i], i]
    for row in free:
        if row < k:
            least = _reduced(costs[row], left, reduced)
            if least == np.inf:
                return np.inf
            best = _position(reduced, least)
            total += costs[row, best]
            left[best] = -np.inf
    return total


@numba.njit(cache=True)
def _bid(costs: FloatArray, v: FloatArray, row_of: IntArray, free: IntArray, step: float) -> IntArray:
    """Let free rows outbid others for their cheapest columns (Bertsekas 1988), N times; return what stays free."""
    k, size = len(costs) - 1, len(v)
    queue, reduced = np.empty(len(free) + size, dtype=np.int64), np.empty(size)
    queue[: len(free)] = free
    first_free, end = 0, len(free)
    for _ in range(size):
        if first_free == end:
            break
        row = queue[first_free]
        first_free += 1
        least = _reduced(costs[min(row, k)], v, reduced)
        best = _position(reduced, least)
        reduced[best] = np.inf
        second = _minimum(reduced)
        holder = row_of[best]
        if holder >= 0:
            queue[end] = holder
            end += 1
        v[best] -= (second - least if second < np.inf else 0.0) + step
        row_of[best] = row
    return queue[first_free:end].copy()


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def _relax(
    costs: FloatArray, masked: FloatArray, offset: float, row: int, distances: FloatArray, parents: IntArray
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
def _augment(
    costs: FloatArray,
    v: FloatArray,
    row_of: IntArray,
    start: int,
    distances: FloatArray,
    parents: IntArray,
    masked: FloatArray,
    finals: FloatArray,
    done: IntArray,
) -> float:
    """Assign one more row along a shortest augmenting path; return by how much the bound rises."""
    k = len(costs) - 1
    masked[:] = v
    distances[:] = np.inf
    row, offset, num, first = start, 0.0, 0, 0.0
    while True:
        length = _relax(costs[min(row, k)], masked, offset, row, distances, parents)
        col = _position(distances, length)
        if num == 0:
            first = length
        if row_of[col] < 0:
            break
        finals[num], done[num] = length, col
        num += 1
        masked[col], distances[col] = -np.inf, np.inf
        row = row_of[col]
        offset = length - (costs[min(row, k), col] - v[col])
    for position in range(num):
        v[done[position]] += finals[position] - length
    while True:
        row = parents[col]
        held = _position(row_of, row)
        row_of[col] = row
        if row == start:
            return length - first
        col = held
