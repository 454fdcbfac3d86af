"""What is connected to what in a triangle mesh: edges, boundary, components, defects."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from data_tools.arrays import FloatArray, IntArray

#: A boundary shorter than this times the square root of the area is a hole in a closed surface, not its rim.
OPEN_BOUNDARY = 0.5


def mesh_edges(faces: IntArray) -> IntArray:
    """Return the undirected edges of triangles (f, 3), shape (e, 2): smaller index first, in lexicographic order."""
    return counted_edges(faces)[0]


def boundary_edges(faces: IntArray) -> IntArray:
    """Return the edges of exactly one triangle, shape (b, 2)."""
    edges, num_faces = counted_edges(faces)
    return edges[num_faces == 1]


def counted_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return the edges, and in how many triangles each is: 1 on the boundary, more than 2 where it is no manifold."""
    first, second = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    num_vertices = int(faces.max(initial=0)) + 1
    # One integer per edge: sorting these is a hundred times as fast as rows.
    keys = np.sort(np.minimum(first, second) * num_vertices + np.maximum(first, second))
    starts = np.flatnonzero(np.diff(keys, prepend=-1))
    return np.stack(np.divmod(keys[starts], num_vertices), axis=1), np.diff(starts, append=len(keys))


def face_crosses(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return (b - a) x (c - a) of the triangles' corners, shape (f, 3): the normal, twice as long as the area."""
    a, b, c = vertices.take(faces.T, axis=0)
    return np.asarray(np.cross(b - a, c - a))


def face_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the triangles' areas, shape (f,)."""
    blocks = np.array_split(faces, 1 + len(faces) // 2**15)  # their crosses stay in the processor's cache
    return 0.5 * np.concatenate([np.linalg.norm(face_crosses(vertices, block), axis=1) for block in blocks])


def vertex_components(num_vertices: int, edges: IntArray) -> tuple[int, IntArray]:
    """Return the number of connected components and each vertex's label, shape (v,)."""
    graph = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(num_vertices, num_vertices))
    num, labels = connected_components(graph, directed=False)
    return int(num), labels.astype(np.int64)


def is_open_surface(vertices: FloatArray, faces: IntArray) -> bool:
    """Whether a mesh has a rim: a boundary that is long compared with its size (small holes do not count)."""
    if not len(faces):
        return False
    size = float(np.sqrt(face_areas(vertices, faces).sum()))
    one, other = boundary_edges(faces).T
    return float(np.linalg.norm(vertices[one] - vertices[other], axis=1).sum()) > OPEN_BOUNDARY * size
