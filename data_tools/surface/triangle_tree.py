"""A tree of boxes around the triangles of a surface, in which the closest triangle of a point is found.

Compiled by Numba: no library of this project has exact closest points, and lists of arrays take twenty times as long.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from data_tools.arrays import FloatArray, IntArray

#: Triangles of a box that is not divided.
_LEAF = 4
#: Boxes that wait to be looked into: two for each level, and no tree has so many levels.
_MOST_WAITING = 128


class TriangleTree(NamedTuple):
    """Boxes within boxes.

    Attributes
    ----------
    corners : ndarray, shape (f, 3, 3)
        Of the triangles, in the order of the boxes.
    order : ndarray of int, shape (f,)
        Which triangle each of them is.
    low, high : ndarray, shape (n, 3)
        Of the boxes.
    spans : ndarray of int, shape (n, 2)
        Which triangles are in each box: the first, and the one behind the last.
    halves : ndarray of int, shape (n,)
        The first of the two boxes that each is divided into, the second follows; 0 where it is not divided.
    """

    corners: FloatArray
    order: IntArray
    low: FloatArray
    high: FloatArray
    spans: IntArray
    halves: IntArray


def triangle_tree(vertices: FloatArray, faces: IntArray) -> TriangleTree:
    """Return the tree of a surface's triangles; boxes are halved by the middle of their longest side.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
    """
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    order, most = np.arange(len(faces)), 2 * len(faces)
    low, high = np.empty((2, most, 3))
    spans, halves = np.zeros((most, 2), dtype=np.int64), np.zeros(most, dtype=np.int64)
    num = _divide(corners, order, low, high, spans, halves)
    return TriangleTree(
        corners=corners[order],
        order=order,
        low=low[:num].copy(),
        high=high[:num].copy(),
        spans=spans[:num].copy(),
        halves=halves[:num].copy(),
    )


@numba.njit(cache=True)
def _divide(
    corners: FloatArray,
    order: IntArray,
    low: FloatArray,
    high: FloatArray,
    spans: IntArray,
    halves: IntArray,
) -> int:
    """Write the boxes of a tree, and the order of its triangles; return how many boxes there are."""
    middles, spare = np.empty(len(order)), np.empty(len(order), dtype=np.int64)
    spans[0, 1], num, box = len(order), 1, 0
    while box < num:
        first, end = spans[box, 0], spans[box, 1]
        longest, along = -1.0, 0
        for axis in range(3):
            least, greatest = np.inf, -np.inf
            for at in range(first, end):
                for corner in range(3):
                    least = min(least, corners[order[at], corner, axis])
                    greatest = max(greatest, corners[order[at], corner, axis])
            low[box, axis], high[box, axis] = least, greatest
            if greatest - least > longest:
                longest, along = greatest - least, axis
        if end - first > _LEAF:
            for at in range(first, end):
                row = order[at]
                middles[row] = (
                    corners[row, 0, along] + corners[row, 1, along] + corners[row, 2, along]
                )
            _sort(order, middles, spare, first, end)
            half = (first + end) // 2
            halves[box] = num
            spans[num, 0], spans[num, 1] = first, half
            spans[num + 1, 0], spans[num + 1, 1] = half, end
            num += 2
        box += 1
    return num


@numba.njit(cache=True)
def _sort(items: IntArray, values: FloatArray, spare: IntArray, first: int, end: int) -> None:
    """Sort some of the items by their values, of equal ones the first first; NumPy's way takes 4 s to compile."""
    width = 1
    while width < end - first:
        for start in range(first, end, 2 * width):
            middle, stop = min(start + width, end), min(start + 2 * width, end)
            left, right = start, middle
            for at in range(start, stop):
                if left < middle and (right >= stop or values[items[left]] <= values[items[right]]):
                    spare[at] = items[left]
                    left += 1
                else:
                    spare[at] = items[right]
                    right += 1
        for at in range(first, end):
            items[at] = spare[at]
        width *= 2


@numba.njit(cache=True)
def closest_triangles(tree: TriangleTree, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the closest triangle of each point, and barycentric coordinates of the closest place on it.

    Of triangles that are equally near it is the first.

    Parameters
    ----------
    tree : TriangleTree
    points : ndarray, shape (q, 3)

    Returns
    -------
    triangles : ndarray of int, shape (q,)
    weights : ndarray, shape (q, 3)
    """
    triangles, weights = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 3))
    waiting, apart = np.empty(_MOST_WAITING, dtype=np.int64), np.empty(_MOST_WAITING)
    for at in range(len(points)):
        point = points[at]
        best, num = np.inf, 1
        waiting[0], apart[0] = 0, 0.0
        while num:
            num -= 1
            box = waiting[num]
            if apart[num] > best:
                continue
            if tree.halves[box]:
                near, far = tree.halves[box], tree.halves[box] + 1
                to_near = _gap(point, tree.low[near], tree.high[near])
                to_far = _gap(point, tree.low[far], tree.high[far])
                if to_far < to_near:
                    near, far, to_near, to_far = far, near, to_far, to_near
                waiting[num], apart[num] = far, to_far
                waiting[num + 1], apart[num + 1] = near, to_near
                num += 2
                continue
            for row in range(tree.spans[box, 0], tree.spans[box, 1]):
                corner = tree.corners[row]
                found = closest_on_triangle(point, corner)
                squared = 0.0
                for axis in range(3):
                    place = (
                        found[0] * corner[0, axis]
                        + found[1] * corner[1, axis]
                        + found[2] * corner[2, axis]
                    )
                    squared += (place - point[axis]) ** 2
                which = tree.order[row]
                if squared < best or (squared == best and which < triangles[at]):
                    best, triangles[at] = squared, which
                    weights[at, 0], weights[at, 1], weights[at, 2] = found
    return triangles, weights


@numba.njit(cache=True)
def _gap(point: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Return the squared distance of a point from a box."""
    total = 0.0
    for axis in range(3):
        beyond = max(low[axis] - point[axis], 0.0, point[axis] - high[axis])
        total += beyond * beyond
    return total


@numba.njit(cache=True)
def closest_on_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return barycentric coordinates of the place on each triangle (q, 3, 3) that is closest to a point (q, 3)."""
    weights = np.empty(points.shape)
    for at in range(len(points)):
        weights[at, 0], weights[at, 1], weights[at, 2] = closest_on_triangle(
            points[at], corners[at]
        )
    return weights


@numba.njit(cache=True)
def closest_on_triangle(point: FloatArray, corners: FloatArray) -> tuple[float, float, float]:
    """Return barycentric coordinates of the place on a triangle that is closest to a point.

    Parameters
    ----------
    point : ndarray, shape (3,)
    corners : ndarray, shape (3, 3)
        Corners are rows. A triangle of no area is taken as its edges.

    References
    ----------
    Ericson, Real-Time Collision Detection (2005), section 5.1.5: the seven Voronoi regions of a triangle.
    """
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for axis in range(3):
        ab = corners[1, axis] - corners[0, axis]
        ac = corners[2, axis] - corners[0, axis]
        from_a, from_b, from_c = (
            point[axis] - corners[0, axis],
            point[axis] - corners[1, axis],
            point[axis] - corners[2, axis],
        )
        d1, d2 = d1 + ab * from_a, d2 + ac * from_a
        d3, d4 = d3 + ab * from_b, d4 + ac * from_b
        d5, d6 = d5 + ab * from_c, d6 + ac * from_c
    on_ab, on_ac, on_bc = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    area = on_ab + on_ac + on_bc
    if d1 <= 0 and d2 <= 0:
        second, third = 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        second, third = 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        second, third = 0.0, 1.0
    elif on_ab <= 0 and d1 >= 0 and d3 <= 0:
        second, third = _ratio(d1, d1 - d3), 0.0
    elif on_ac <= 0 and d2 >= 0 and d6 <= 0:
        second, third = 0.0, _ratio(d2, d2 - d6)
    elif on_bc <= 0 and d4 >= d3 and d5 >= d6:
        third = _ratio(d4 - d3, (d4 - d3) + (d5 - d6))
        second = 1.0 - third
    else:
        second, third = _ratio(on_ac, area), _ratio(on_ab, area)
    first, second, third = (
        min(max(1.0 - second - third, 0.0), 1.0),
        min(max(second, 0.0), 1.0),
        min(max(third, 0.0), 1.0),
    )
    total = first + second + third
    return first / total, second / total, third / total


@numba.njit(cache=True)
def _ratio(part: float, whole: float) -> float:
    return part / whole if whole != 0 else part
