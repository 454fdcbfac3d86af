"""Meshes of fewer triangles."""

from __future__ import annotations

import fast_simplification
import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.topology import face_areas, vertex_components

#: Edges of a mesh of more triangles are not collapsed one by one before vertices near each other are put together.
MOST_COLLAPSED = 200_000
#: Vertices that are left of such a mesh, about. A generated bone of 600 000 triangles, decimated to 4000, then lies
#: 3.6e-4 sqrt(area) from the original (root mean square) instead of 3.2e-4.
_NUM_CLUSTERS = MOST_COLLAPSED // 4
#: The three clusters of a triangle fit into one integer of 64 bits.
_MOST_KEYED = 2**21
#: Cells of a cubic grid that a surface passes through, for an area of one cell's side.
_CELLS_PER_AREA = 1.5


def decimate(vertices: FloatArray, faces: IntArray, max_faces: int) -> tuple[FloatArray, IntArray]:
    """Return a mesh of at most about ``max_faces`` triangles by quadric decimation (Garland and Heckbert 1997).

    Of a mesh of more than :data:`MOST_COLLAPSED` triangles, vertices of one cell of a grid that edges inside the cell
    connect are first replaced by their mean (Rossignac and Borrel 1993, but sheets that only come near stay apart).

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
    max_faces : int

    Returns
    -------
    vertices : ndarray, shape (w, 3)
    faces : ndarray of int, shape (g, 3)
        Some may be degenerate.
    """
    if len(faces) > MOST_COLLAPSED:
        vertices, faces = _clustered(vertices, faces)
    if len(faces) <= max_faces:
        return vertices, faces
    # The thresholds of the library are lengths: without a common unit, millimetres and metres would differ.
    centre, unit = vertices.mean(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    scaled = (vertices - centre) / unit
    small, triangles = fast_simplification.simplify(scaled, faces.astype(np.int32), target_count=max_faces)
    return unit * np.asarray(small, dtype=np.float64) + centre, np.asarray(triangles, dtype=np.int64)


def _clustered(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Return a mesh whose vertices are the means of connected vertices of one cell."""
    side = float(np.sqrt(_CELLS_PER_AREA * face_areas(vertices, faces).sum() / _NUM_CLUSTERS))
    cells = np.floor((vertices - vertices.min(axis=0)) / side).astype(np.int64)
    x, y, z = cells.T
    sizes = cells.max(axis=0) + 1
    cell = (x * sizes[1] + y) * sizes[2] + z
    corners = np.ascontiguousarray(faces.T)
    of = cell[corners]
    sides = ((corners[[i, i - 1]], of[i] == of[i - 1]) for i in range(3))
    num, cluster = vertex_components(len(vertices), (ends.compress(inside, axis=1).T for ends, inside in sides))
    if num > _MOST_KEYED:
        return vertices, faces
    counts = np.bincount(cluster, minlength=num)
    means = np.column_stack([np.bincount(cluster, weights=axis, minlength=num) for axis in vertices.T])
    a, b, c = corners = cluster[corners]
    triangles = corners.T[(a != b) & (b != c) & (c != a)]
    a, b, c = np.sort(triangles, axis=1).T
    # Where a fold of the surface became flat, two triangles lie on each other; neither is left.
    key = (a * num + b) * num + c
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    odd = np.diff(starts, append=len(key)) % 2 == 1
    return means / counts[:, None], triangles[np.sort(order[starts[odd]])]
