"""Meshes for looking at: few triangles, the same outline."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.decimation import decimate

#: A report holds about this many triangles in all, but each shape between the two limits.
_FACES_IN_ALL = 200_000
FEWEST_FACES, _MOST = 1_500, 4_000
#: No collection holds more triangles than this: of many thousand shapes each has fewer than :data:`FEWEST_FACES`.
_MOST_IN_ALL = 4_000_000


def faces_per_shape(num_shapes: int) -> int:
    """Return triangles per shape that keep a report of ``num_shapes`` shapes small enough to send."""
    num = max(num_shapes, 1)
    return min(int(np.clip(_FACES_IN_ALL // num, FEWEST_FACES, _MOST)), max(_MOST_IN_ALL // num, 1))


def display_mesh(vertices: FloatArray, faces: IntArray, *, max_faces: int) -> tuple[FloatArray, IntArray]:
    """Decimate a mesh by edge collapses, or thin out a point cloud evenly.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Empty for a point cloud.
    max_faces : int
        Triangles (points for a cloud) to keep, about.

    Returns
    -------
    vertices : ndarray, shape (w, 3)
    faces : ndarray of int, shape (g, 3)
    """
    if not len(faces):
        stride = -(-len(vertices) // max_faces)
        return np.ascontiguousarray(vertices[::stride]), np.empty((0, 3), dtype=np.int64)
    return decimate(vertices, faces, max_faces)
