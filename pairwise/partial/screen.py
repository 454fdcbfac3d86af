"""The coarse search: the best shift and scale at each of many rotations, by few points of both surfaces."""

from __future__ import annotations

import numba
import numpy as np

from data_tools.arrays import FloatArray, IntArray
from pairwise.partial.surface import PartialSurface
from pairwise.partial.tuning import TUNED

#: Points of each surface that are compared, and the cutoff in radii of the target.
NUM_POINTS, CUTOFF = 64, 0.35


def screen_similarities(
    target: PartialSurface,
    source: PartialSurface,
    rotations: FloatArray,
    shifts: FloatArray,
    scale: float,
) -> tuple[FloatArray, IntArray]:
    """Return the least mean truncated cost at each rotation, and which shift it has.

    Points of both surfaces look up the nearest one of the other in its grid; a cost is the squared distance plus the
    weighted squared difference of normals, where both know their signs, at most the squared cutoff.

    Parameters
    ----------
    target, source : PartialSurface
        In radii of the target.
    rotations : ndarray, shape (r, 3, 3)
    shifts : ndarray, shape (t, 3)
    scale : float

    Returns
    -------
    costs : ndarray, shape (r,)
    which_shift : ndarray of int, shape (r,)
    """
    to, of = (
        (surface.grid, surface.corner, surface.cell, surface.points, surface.normals)
        for surface in (target, source)
    )
    weight = TUNED.normal_weight if target.oriented and source.oriented else 0.0
    rotated, rotated_normals = (
        few[:NUM_POINTS] @ np.swapaxes(rotations, 1, 2) for few in (source.points, source.normals)
    )
    rotated_back, normals_rotated_back = (
        few[:NUM_POINTS] @ rotations for few in (target.points, target.normals)
    )
    back = -(shifts @ rotations) / scale
    return _screen(
        to,
        of,
        (rotated, rotated_normals),
        (rotated_back, normals_rotated_back),
        shifts,
        back,
        scale,
        weight**2,
    )


@numba.njit(cache=True)
def _nearest(grid, corner, cell, place):  # type: ignore[no-untyped-def]
    i = int(np.floor((place[0] - corner[0]) / cell))
    j = int(np.floor((place[1] - corner[1]) / cell))
    k = int(np.floor((place[2] - corner[2]) / cell))
    if i < 0 or j < 0 or k < 0 or i >= grid.shape[0] or j >= grid.shape[1] or k >= grid.shape[2]:
        return -1
    return grid[i, j, k]


@numba.njit(cache=True)
def _mean_cost(surface, moved, scale, shift, costs, enough):  # type: ignore[no-untyped-def]
    """Return the mean truncated cost of moved places from the nearest points, or anything above enough."""
    (grid, corner, cell, points, directions), (places, normals), (factor, weight) = (
        surface,
        moved,
        costs,
    )
    most = CUTOFF**2
    num = places.shape[0]
    total, place = 0.0, np.empty(3)
    for m in range(num):
        for a in range(3):
            place[a] = scale * places[m, a] + shift[a]
        n = _nearest(grid, corner, cell, place)
        cost = most
        if n >= 0:
            squared, rotated = 0.0, 0.0
            for a in range(3):
                squared += (place[a] - points[n, a]) ** 2
                rotated += (normals[m, a] - directions[n, a]) ** 2
            cost = min(factor * squared + weight * rotated, most)
        total += cost
        if total > enough * num:
            break
    return total / num


@numba.njit(cache=True)
def _screen(target, source, rotated, rotated_back, shifts, back, scale, weight):  # type: ignore[no-untyped-def]
    """Return what :func:`screen_similarities` does; products of matrices, made outside, take seconds to compile."""
    num = back.shape[0]
    costs, which_shift = np.empty(num), np.zeros(num, np.int64)
    for r in range(num):
        costs[r] = np.inf
        there, home = (rotated[0][r], rotated[1][r]), (rotated_back[0][r], rotated_back[1][r])
        for t in range(shifts.shape[0]):
            cost = _mean_cost(target, there, scale, shifts[t], (1.0, weight), 2.0 * costs[r])
            if cost >= 2.0 * costs[r]:
                continue
            rest = 2.0 * costs[r] - cost
            cost += _mean_cost(source, home, 1.0 / scale, back[r, t], (scale**2, weight), rest)
            if cost < 2.0 * costs[r]:
                costs[r], which_shift[r] = 0.5 * cost, t
    return costs, which_shift
