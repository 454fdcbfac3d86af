"""Range scans of a mesh: what a depth camera sees of it from some direction."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.embedding.surface_cells import centre_and_radius, spread_over_triangles
from data_tools.errors import OptionsError
from data_tools.surface.shape import Shape

#: Points that are spread over the mesh for each pixel that it covers, so that hardly a pixel stays empty.
_POINTS_A_PIXEL = 6.0
#: Least cosine between normal and line of sight of what a scanner still sees.
_STEEPEST_COSINE = 0.15


def range_view(
    shape: Shape, direction: FloatArray, *, pixels: int = 90, noise: float = 0.0, rng: np.random.Generator
) -> FloatArray:
    """Return the points of a mesh that a depth camera far away sees, in the coordinates of the mesh, shape (n, 3).

    Parameters
    ----------
    shape : Shape
        A mesh whose triangles wind outwards.
    direction : ndarray, shape (3,)
        From the mesh to the camera.
    pixels : int
        Pixels across four root mean square radii.
    noise : float
        Standard deviation of the depth, in root mean square radii.
    rng : numpy.random.Generator
        Of the noise.

    Raises
    ------
    OptionsError
        If the shape has no triangles.
    """
    if not shape.is_mesh:
        raise OptionsError("range views need a mesh")
    centre, radius = centre_and_radius(shape)
    size = 4.0 * radius / pixels
    points, normals = spread_over_triangles(shape, size / np.sqrt(_POINTS_A_PIXEL))
    sight = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    across = np.linalg.svd(sight[None])[2][1:].T
    depth = (points - centre) @ sight
    at = np.floor((points - centre) @ across / size).astype(np.int64)
    at -= at.min(axis=0)
    cells = at[:, 0] * (at[:, 1].max() + 1) + at[:, 1]
    order = np.lexsort((-depth, cells))
    nearest = order[np.unique(cells[order], return_index=True)[1]]
    seen = nearest[normals[nearest] @ sight > _STEEPEST_COSINE]
    return np.asarray(read_only(points[seen] + noise * radius * rng.standard_normal(len(seen))[:, None] * sight))
