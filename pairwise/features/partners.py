"""Nearest points of a surface whose normals agree, for points at many poses, by a grid.

Of a thin wall both sides are near: the nearest point alone would be of the wrong one.

Compiled by Numba: the grid leaves some dozens of points to look at. NumPy's products of all with all take twice as
long.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.local_surface import SurfacePlanes

#: Cells of the grid along its longest side, at most.
_MOST_CELLS = 100


class FacingGrid(NamedTuple):
    """Points and normals of a surface, (n, 6), in the order of the cells of a grid, made once for many looks.

    ``starts`` are those of the cells, ``sizes`` their numbers along each axis, ``low`` and ``side`` (a float) say
    where they are, and ``order`` (n,) which points the rows are.
    """

    rows: FloatArray
    order: IntArray
    starts: IntArray
    sizes: IntArray
    low: FloatArray
    side: float

    @classmethod
    def of(cls, surface: SurfacePlanes, reach: float) -> FacingGrid:
        """Return the grid of a surface whose cells are at least as large as what is looked for is far."""
        points = surface.points
        low, extent = points.min(axis=0), np.ptp(points, axis=0)
        side = max(reach, float(extent.max()) / _MOST_CELLS)
        # With an empty layer on every side each cell that holds a point has all its neighbours.
        sizes = np.floor(extent / side).astype(np.int64) + 3
        x, y, z = np.floor((points - low) / side).astype(np.int64).T + 1
        cells = (x * sizes[1] + y) * sizes[2] + z
        order = np.argsort(cells, kind="stable")
        starts = np.zeros(sizes.prod() + 1, dtype=np.int64)
        np.cumsum(np.bincount(cells, minlength=len(starts) - 1), out=starts[1:])
        return cls(np.hstack([points, surface.normals])[order], order, starts, sizes, low, side)


def nearest_facing(
    others: SurfacePlanes,
    own: tuple[FloatArray, FloatArray],
    *,
    reach: float,
    cosine: float,
) -> tuple[FloatArray, IntArray]:
    """Return squared distance and index, shape (q,) each, of each point's nearest other one whose normal agrees.

    Parameters
    ----------
    others : SurfacePlanes
    own : pair of ndarray, shapes (q, 3)
        Points and unit normals.
    reach : float
        What is farther away is not found: the distance is then infinite, and the index says nothing.
    cosine : float
        Normals agree if the cosine between them is above this.
    """
    grid = others.kept.get(reach)
    if grid is None:
        grid = others.kept[reach] = FacingGrid.of(others, reach)
    squares, nearest = np.full(len(own[0]), np.inf), np.zeros(len(own[0]), dtype=np.int64)
    _look(
        grid.rows,
        grid.starts,
        grid.sizes,
        (own[0] - grid.low) / grid.side + 1.0,
        np.hstack(own),
        np.array([reach**2, cosine, grid.side**2]),
        squares,
        nearest,
    )
    return squares, grid.order[nearest]


@numba.njit(cache=True)
def _look(
    others: FloatArray,
    starts: IntArray,
    sizes: IntArray,
    places: FloatArray,
    own: FloatArray,
    limits: FloatArray,
    squares: FloatArray,
    nearest: IntArray,
) -> None:
    """Write squared distance and index of each row's nearest other one in its cell and those around it.

    Rows are points and normals, (n, 6) and (q, 6), the others in the order of their cells. ``places`` (q, 3) are in
    cells; ``limits`` are the largest squared distance, the least cosine and the squared side of a cell.
    """
    farthest, cosine, unit = limits
    for i in range(len(own)):
        x, y, z = places[i]
        if not (0 <= x < sizes[0] and 0 <= y < sizes[1] and 0 <= z < sizes[2]):
            continue
        least = farthest
        for a in (0, -1, 1):
            far_x = unit * _gap(x, a)
            for b in (0, -1, 1):
                far_xy = far_x + unit * _gap(y, b)
                if far_xy >= least:
                    continue
                line = ((int(x) + a) * sizes[1] + int(y) + b) * sizes[2]
                for c in (0, -1, 1):
                    cell = line + int(z) + c
                    if not (0 <= cell < len(starts) - 1) or far_xy + unit * _gap(z, c) >= least:
                        continue
                    for k in range(starts[cell], starts[cell + 1]):
                        square, product = 0.0, 0.0
                        for d in range(3):
                            square += (own[i, d] - others[k, d]) ** 2
                            product += own[i, d + 3] * others[k, d + 3]
                        if square < least and product > cosine:
                            least = square
                            squares[i], nearest[i] = square, k


@numba.njit(cache=True)
def _gap(place: float, step: int) -> float:
    """Return the squared distance, in cells, of a place to the cell so many steps from its own."""
    inside = place - int(place)
    away = inside if step < 0 else 1.0 - inside
    return away * away if step else 0.0
