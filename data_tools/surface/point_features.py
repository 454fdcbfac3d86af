"""Fast point feature histograms, compiled by Numba: arrays of all pairs of neighbours take about twice as long."""

from __future__ import annotations

import math
from typing import TypeAlias

import numba
import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray

_TINY = float(np.finfo(np.float64).tiny)
_Vector: TypeAlias = tuple[float, float, float]


def fast_point_features(
    points: FloatArray, normals: FloatArray, radius: float, num_bins: int
) -> FloatArray:
    """Return the fast point feature histogram of every point, shape (l, 3 b); each sums to 1.

    Three angles of a Darboux frame between a point and each neighbour within the radius, in b bins each, and the
    neighbours' histograms weighted by inverse distance (Rusu, Blodow and Beetz, ICRA 2009, equations 1 to 3).

    Parameters
    ----------
    points, normals : ndarray, shape (l, 3)
        The normals are of unit length.
    radius : float
        In the units of the points.
    num_bins : int
        Bins of each angle.
    """
    pairs = scipy.spatial.cKDTree(points).query_pairs(radius, output_type="ndarray")
    # Copies: of arrays that must not be written Numba would compile another version.
    return _histograms(np.array(points), np.array(normals), pairs, num_bins)


@numba.njit(cache=True)
def _histograms(
    points: FloatArray, normals: FloatArray, pairs: IntArray, num_bins: int
) -> FloatArray:
    """Return the histograms (l, 3 b) from the pairs of neighbours (e, 2), each once; not those in one place."""
    num = len(points)
    simple, nearby = np.zeros((num, 3 * num_bins)), np.zeros((num, 3 * num_bins))
    count, total, weights = np.zeros(num), np.zeros(num), np.zeros(len(pairs))
    for p in range(len(pairs)):
        i, j = pairs[p]
        arm = (
            points[j, 0] - points[i, 0],
            points[j, 1] - points[i, 1],
            points[j, 2] - points[i, 2],
        )
        length = math.sqrt(_dot(arm, arm))
        if length > 0.0:
            weights[p] = 1.0 / length
            unit = (arm[0] / length, arm[1] / length, arm[2] / length)
            own = (normals[i, 0], normals[i, 1], normals[i, 2])
            other = (normals[j, 0], normals[j, 1], normals[j, 2])
            _count(simple[i], unit, own, other)
            _count(simple[j], (-unit[0], -unit[1], -unit[2]), other, own)
            for one in (i, j):
                count[one] += 3.0
                total[one] += weights[p]
    for i in range(num):
        for k in range(3 * num_bins):
            simple[i, k] /= max(count[i], 1.0)
    for p in range(len(pairs)):
        i, j = pairs[p]
        _add(nearby[i], weights[p], simple[j])
        _add(nearby[j], weights[p], simple[i])
    for i in range(num):
        for k in range(3 * num_bins):
            nearby[i, k] /= max(total[i], _TINY)
    return 0.5 * (simple + nearby)


@numba.njit(cache=True)
def _add(values: FloatArray, weight: float, others: FloatArray) -> None:
    for k in range(len(values)):
        values[k] += weight * others[k]


@numba.njit(cache=True)
def _count(histogram: FloatArray, arm: _Vector, own: _Vector, other: _Vector) -> None:
    """Count the three angles of a point and a neighbour, which lies along a unit vector, with their normals."""
    num_bins = len(histogram) // 3
    across = _cross(arm, own)
    length = max(math.sqrt(_dot(across, across)), 1e-9)
    across = (across[0] / length, across[1] / length, across[2] / length)
    third = math.atan2(_dot(_cross(own, across), other), _dot(own, other)) / math.pi
    for k, angle in enumerate((_dot(across, other), _dot(own, arm), third)):
        place = int((angle + 1.0) * (num_bins / 2.0))
        histogram[k * num_bins + min(max(place, 0), num_bins - 1)] += 1.0


@numba.njit(cache=True)
def _dot(first: _Vector, second: _Vector) -> float:
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


@numba.njit(cache=True)
def _cross(first: _Vector, second: _Vector) -> _Vector:
    return (
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    )
