"""Least squares over convex combinations, for many pairs at once. Compiled by Numba: a step is a few operations."""

from __future__ import annotations

import numba
import numpy as np

from data_tools.arrays import FloatArray, IntArray

#: Most steps of one combination at a time; the next call goes on from there.
_MOST_STEPS = 200


@numba.njit(cache=True)
def combine(
    points: FloatArray, costs: FloatArray, starts: IntArray, wanted: FloatArray, weight: float, shares: FloatArray
) -> None:
    """Improve shares of points in place: minimise ``<costs, shares> + weight |points^T shares - wanted|^2``.

    The shares of each group are a convex combination. Each step moves share from the point of largest gradient that
    has some to the point of least gradient, as far as the objective falls.

    Parameters
    ----------
    points : ndarray, shape (t, c)
    costs : ndarray, shape (t,)
    starts : ndarray of int, shape (g + 1,)
        Where the points of each group begin.
    wanted : ndarray, shape (g, c)
    weight : float
    shares : ndarray, shape (t,)
        Start and result, non-negative, of sum one in each group.
    """
    for group in range(len(starts) - 1):
        first, last = starts[group], starts[group + 1]
        own, share = points[first:last], shares[first:last]
        gradient = costs[first:last] + 2.0 * weight * (own @ (own.T @ share - wanted[group]))
        for _ in range(_MOST_STEPS):
            low, high = np.argmin(gradient), -1
            for at in range(len(share)):
                if share[at] > 0.0 and (high < 0 or gradient[at] > gradient[high]):
                    high = at
            step = own[low] - own[high]
            fall, bend = gradient[high] - gradient[low], 2.0 * weight * (step @ step)
            if fall <= 1e-9 * abs(gradient[high]):
                break
            moved = min(share[high], fall / bend) if bend > 0.0 else share[high]
            share[low] += moved
            share[high] = max(0.0, share[high] - moved)
            gradient += (2.0 * weight * moved) * (own @ step)
