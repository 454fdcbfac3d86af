"""What is connected to what in a triangle mesh: edges, boundary, components, defects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from data_tools.arrays import BoolArray, FloatArray, IntArray

#: A boundary shorter than this times the square root of the area is a hole in a closed surface, not its rim.
OPEN_BOUNDARY = 0.5


@dataclass(frozen=True, eq=False)
class Edges:
    """The undirected edges of a mesh.

    Attributes
    ----------
    vertices : ndarray of int, shape (e, 2)
        Smaller index first, in lexicographic order.
    num_faces : ndarray of int, shape (e,)
        In how many triangles each edge is: 1 on the boundary, more than 2 where the mesh is not a manifold.
    consistent : ndarray of bool, shape (e,)
        Whether an inner edge runs in opposite directions in its two triangles.
    """

    vertices: IntArray
    num_faces: IntArray
    consistent: BoolArray

    @property
    def boundary(self) -> IntArray:
        """Edges of exactly one triangle, shape (b, 2)."""
        return self.vertices[self.num_faces == 1]


def mesh_edges(faces: IntArray) -> Edges:
    """Return the edges of triangles given as an (f, 3) array."""
    first, second = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    num_vertices = int(faces.max(initial=0)) + 1
    # One integer per directed edge, its direction in the last bit: sorting these is a hundred times as fast as rows.
    keys = np.minimum(first, second) * num_vertices + np.maximum(first, second)
    keys = np.sort(2 * keys + (first < second))
    forward, keys = keys & 1, keys >> 1
    starts = np.flatnonzero(np.diff(keys, prepend=-1))
    counts = np.diff(starts, append=len(keys))
    num_forward = np.add.reduceat(forward, starts) if len(starts) else counts
    return Edges(np.stack(np.divmod(keys[starts], num_vertices), axis=1), counts, num_forward * 2 == counts)


def face_crosses(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return (b - a) x (c - a) of the triangles' corners, shape (f, 3): the normal, twice as long as the area."""
    a, b, c = vertices[faces.T]
    return np.asarray(np.cross(b - a, c - a))


def face_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the triangles' areas, shape (f,)."""
    return 0.5 * np.linalg.norm(face_crosses(vertices, faces), axis=1)


def vertex_components(num_vertices: int, edges: IntArray) -> tuple[int, IntArray]:
    """Return the number of connected components and each vertex's label, shape (v,)."""
    graph = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(num_vertices, num_vertices))
    num, labels = connected_components(graph, directed=False)
    return int(num), labels.astype(np.int64)


def boundary_length(vertices: FloatArray, edges: Edges) -> float:
    """Return the total length of the edges that belong to one triangle only."""
    rim = edges.boundary
    return float(np.linalg.norm(vertices[rim[:, 0]] - vertices[rim[:, 1]], axis=1).sum())


def is_open_surface(vertices: FloatArray, faces: IntArray) -> bool:
    """Whether a mesh has a rim: a boundary that is long compared with its size (small holes do not count)."""
    if not len(faces):
        return False
    size = float(np.sqrt(face_areas(vertices, faces).sum()))
    return boundary_length(vertices, mesh_edges(faces)) > OPEN_BOUNDARY * size
