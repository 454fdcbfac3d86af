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

from data_tools.arrays import FloatArray, IntArray
from pairwise.branch_and_bound.exact_assignment import augment, position, reduce_row

_EPS = float(np.finfo(np.float64).eps)


@numba.njit(cache=True)
def bound_assignments(
    fixed: FloatArray,
    source: FloatArray,
    targets: FloatArray,
    potentials: FloatArray,
    wanted: FloatArray,
    steps: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bound the assignments of costs ``fixed[i, j] + <q_i, p_j>`` for many sets of points q.

    Parameters
    ----------
    fixed : ndarray, shape (N, k)
        ``inf`` where j must not go to i.
    source : ndarray, shape (3, k)
        Coordinates of p_j, with every factor that the costs have.
    targets : ndarray, shape (m, 3, N)
        Coordinates of q_i.
    potentials : ndarray, shape (m, N)
        What each problem starts from; what proves each bound is written there.
    wanted, steps : ndarray, shape (m,)
        Stop when the bound exceeds this, or is within N steps of the optimum.

    Returns
    -------
    bounds : ndarray, shape (m,)
        Lower bounds of the least costs, the rounding of their sums accounted for.
    energies : ndarray, shape (m,)
        Cost of some assignment where the bound is not what was wanted, else ``inf``.
    moments : ndarray, shape (m, 3, 3)
        ``sum_j q_map(j) p_j^T`` of that assignment.
    """
    (size, k), num, rows = fixed.shape, len(targets), np.ascontiguousarray(fixed.T)
    bounds, energies, moments = np.empty(num), np.full(num, np.inf), np.zeros((num, 3, 3))
    costs, before, minima = np.zeros((k + 1, size)), np.empty(size), np.empty(k)
    row_of, places = np.empty(size, dtype=np.int64), np.empty(k, dtype=np.int64)
    for c in range(num):
        v = potentials[c]
        start = _dual_value(fixed, source, targets[c], v, minima, places)
        bounds[c] = start
        if start > wanted[c]:
            continue
        before[:] = v
        _fill(costs, rows, source, targets[c])
        free = _bid(costs, v, row_of, _take_tight(v, places, row_of), steps[c])
        value = _dual_value(fixed, source, targets[c], v, minima, places)
        if value <= wanted[c]:
            energies[c] = _finish(costs, v, row_of, free, value, wanted[c])
            if energies[c] < np.inf:
                _add_moment(moments[c], source, targets[c], row_of)
            value = _dual_value(fixed, source, targets[c], v, minima, places)
        bounds[c] = max(value, start)
        if value < start:
            v[:] = before
    return bounds, energies, moments


@numba.njit(cache=True)
def _add_moment(
    moment: FloatArray, source: FloatArray, target: FloatArray, row_of: IntArray
) -> None:
    """Add the products of the points that are assigned to each other."""
    for i, j in enumerate(row_of):
        if 0 <= j < source.shape[1]:
            for a in range(3):
                for b in range(3):
                    moment[a, b] += target[a, i] * source[b, j]


@numba.njit(cache=True, fastmath={"contract"})
def _fill(costs: FloatArray, rows: FloatArray, source: FloatArray, target: FloatArray) -> None:
    """Write the costs of one problem into all but the last row."""
    for j in range(len(rows)):
        x, y, z = source[0, j], source[1, j], source[2, j]
        for i in range(rows.shape[1]):
            costs[j, i] = rows[j, i] + x * target[0, i] + y * target[1, i] + z * target[2, i]


@numba.njit(cache=True)
def _dual_value(
    fixed: FloatArray,
    source: FloatArray,
    target: FloatArray,
    v: FloatArray,
    minima: FloatArray,
    places: IntArray,
) -> float:
    """Return ``sum_j min_i (c_ji - v_i) + sum_i v_i`` over all N rows, less what its additions may have lost.

    The minima and their columns are written as well. All rows advance together, so that no row is reduced by itself.
    """
    _minima(fixed, source, target, v, minima, places)
    size, num_zero = len(v), len(v) - len(minima)
    least = -v.max() if num_zero else 0.0
    total, sizes = num_zero * least, num_zero * abs(least)
    for part in (minima, v):
        for term in part:
            total += term
            sizes += abs(term)
    return total - _EPS * (2 * size + 4) * sizes


@numba.njit(cache=True, fastmath={"nnan", "nsz", "contract"})
def _minima(
    fixed: FloatArray,
    source: FloatArray,
    target: FloatArray,
    v: FloatArray,
    minima: FloatArray,
    places: IntArray,
) -> None:
    minima[:] = np.inf
    for i in range(len(v)):
        x, y, z = target[0, i], target[1, i], target[2, i]
        for j in range(len(minima)):
            reduced = fixed[i, j] - v[i] + x * source[0, j] + y * source[1, j] + z * source[2, j]
            is_less = reduced < minima[j]
            places[j] = i if is_less else places[j]
            minima[j] = reduced if is_less else minima[j]


@numba.njit(cache=True)
def _finish(
    costs: FloatArray, v: FloatArray, row_of: IntArray, free: IntArray, value: float, wanted: float
) -> float:
    """Assign the rows that are free, and return what it costs: ``inf`` once the bound exceeds what is wanted."""
    taken = row_of.copy()
    energy = _complete(costs, v, taken, free)
    if not len(free) or energy <= wanted:
        row_of[:] = taken
        return energy
    for row in free:
        value += augment(costs, v, row_of, row)
        if value > wanted:
            return np.inf
    return _complete(costs, v, row_of, free[:0])


@numba.njit(cache=True, fastmath={"nnan", "nsz"})
def _minimum(values: FloatArray) -> float:
    least = np.inf
    for i in range(len(values)):
        least = values[i] if values[i] < least else least
    return least


@numba.njit(cache=True)
def _take_tight(v: FloatArray, places: IntArray, row_of: IntArray) -> IntArray:
    """Give every row its cheapest column while that is free, rows of zeros any of theirs; return the others."""
    k, size = len(places), len(v)
    free, num = np.empty(size, dtype=np.int64), 0
    row_of[:] = -1
    for j in range(k):
        if row_of[places[j]] < 0:
            row_of[places[j]] = j
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
def _complete(costs: FloatArray, v: FloatArray, row_of: IntArray, free: IntArray) -> float:
    """Give every free row the cheapest column that others leave it; return the cost, ``inf`` if there is none."""
    k, size = len(costs) - 1, len(v)
    total, reduced, left = 0.0, np.empty(size), v.copy()
    for i in range(size):
        if row_of[i] >= 0:
            left[i] = -np.inf
            if row_of[i] < k:
                total += costs[row_of[i], i]
    for row in free:
        if row < k:
            least = reduce_row(costs[row], left, reduced)
            if least == np.inf:
                return np.inf
            best = position(reduced, least)
            total += costs[row, best]
            left[best], row_of[best] = -np.inf, row
    return total


@numba.njit(cache=True)
def _bid(
    costs: FloatArray, v: FloatArray, row_of: IntArray, free: IntArray, step: float
) -> IntArray:
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
        least = reduce_row(costs[min(row, k)], v, reduced)
        best = position(reduced, least)
        reduced[best] = np.inf
        second = _minimum(reduced)
        holder = row_of[best]
        if holder >= 0:
            queue[end] = holder
            end += 1
        v[best] -= (second - least if second < np.inf else 0.0) + step
        row_of[best] = row
    return queue[first_free:end].copy()
