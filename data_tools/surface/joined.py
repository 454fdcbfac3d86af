"""The surface around all components of an object that is assembled of parts, as one."""

from __future__ import annotations

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray
from data_tools.surface.shape import Shape

#: Cells along the diagonal of the box around the object. Gaps of up to two of them are closed. This and the next two
#: numbers were set once, while looking at published cars, armchairs, beds, bicycles and standing figures; no search
#: was made over them.
NUM_CELLS = 72
#: The surface is so far outside the triangles, in cells: less loses boards and bars thinner than one.
DISTANCE = 0.9
#: Standard deviation of the Gaussian that takes the steps of the cells from the distances, in cells.
SMOOTHING = 0.6
#: Cells around the object that are empty.
_MARGIN_CELLS = 4


def joined_surface(mesh: Shape) -> Shape:
    """Return the closed surface a cell outside all triangles of a mesh, whatever its components and holes.

    Cells that triangles go through are occupied. What an outside cell reaches, without passing gaps of up to two
    cells, is outside; the surface is where the distance to everything else is :data:`DISTANCE` cells (marching
    cubes of Lewiner et al., 2003). So boards that touch become one surface, and what lies within disappears, as the
    seats of a car. Parts that lie farther apart stay components.

    Parameters
    ----------
    mesh : Shape
        With triangles of any number of components, open or closed.

    Returns
    -------
    Shape
        Triangles counterclockwise seen from outside.
    """
    from skimage.measure import marching_cubes

    corner, size, occupied = _occupied_cells(mesh)
    sealed = scipy.ndimage.binary_dilation(occupied)
    regions, _ = scipy.ndimage.label(~sealed)
    outside = scipy.ndimage.binary_dilation(regions == regions[0, 0, 0], mask=~occupied)
    distances = scipy.ndimage.gaussian_filter(
        scipy.ndimage.distance_transform_edt(outside), SMOOTHING
    )
    vertices, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        distances, DISTANCE, gradient_direction="descent"
    )
    return Shape.from_arrays(
        corner + size * (vertices + 0.5), faces, name=mesh.name, file=mesh.file
    )


def cell_size(mesh: Shape) -> float:
    """Return the side of the cells of :func:`joined_surface`."""
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(np.ptp(corners, axis=(0, 1)))) / NUM_CELLS


def _occupied_cells(mesh: Shape) -> tuple[FloatArray, float, BoolArray]:
    """Return the corner (3,) of a grid, the size of its cells, and which of these triangles go through."""
    corners = mesh.vertices[mesh.faces]
    first, last = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = cell_size(mesh)
    corner = first - _MARGIN_CELLS * size
    cells = np.floor((_points_on(corners, size / 2) - corner) / size).astype(np.int64)
    occupied = np.zeros(np.ceil((last - corner) / size).astype(int) + _MARGIN_CELLS, dtype=np.bool_)
    occupied[tuple(cells.T)] = True
    return corner, size, occupied


def _points_on(corners: FloatArray, step: float) -> FloatArray:
    """Return points (p, 3) of triangles, given by their corners (f, 3, 3), at most a step from the next ones.

    Triangles no longer than a step have their corners, others rows of points along their shortest side, from the
    opposite corner on.
    """
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    is_long = sides.max(axis=1) > step
    few = corners[~is_long].reshape(-1, 3)
    corners, sides = corners[is_long], sides[is_long]
    every = np.arange(len(corners))
    tip = sides.argmin(axis=1)
    a, b, c = (corners[every, (tip + n) % 3] for n in range(3))
    num_rows = np.ceil(sides.max(axis=1) / step).astype(np.int64) + 1
    num_columns = np.ceil(sides.min(axis=1) / step).astype(np.int64) + 1
    num = num_rows * num_columns
    owner = np.repeat(every, num)
    at = np.arange(len(owner)) - np.repeat(np.cumsum(num) - num, num)
    row, column = np.divmod(at, num_columns[owner])
    down = (row / (num_rows[owner] - 1))[:, None]
    along = (column / (num_columns[owner] - 1).clip(1))[:, None]
    side = b[owner] + along * (c - b)[owner]
    return np.concatenate([few, a[owner] + down * (side - a[owner])])
