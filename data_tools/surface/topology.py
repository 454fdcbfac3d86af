"""What is connected to what in a triangle mesh: edges, boundary, components, defects."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

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
    """Return the edges (e, 2) and in how many triangles each is: 1 on the boundary, more than 2 where no manifold."""
    first, second = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    num_vertices = int(faces.max(initial=0)) + 1
    # One integer per edge: sorting these is a hundred times as fast as rows.
    keys = np.sort(np.minimum(first, second) * num_vertices + np.maximum(first, second))
    starts = np.flatnonzero(np.diff(keys, prepend=-1))
    return np.stack(np.divmod(keys[starts], num_vertices), axis=1), np.diff(
        starts, append=len(keys)
    )


def face_crosses(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return (b - a) x (c - a) of the triangles' corners, shape (3, f): the normal, twice as long as the area."""
    crosses = np.empty((3, len(faces)))
    for start in range(0, len(faces), 2**13):  # what is between stays in the processor's cache
        block = slice(start, start + 2**13)
        a, b, c = vertices.take(np.ascontiguousarray(faces[block].T), axis=0)
        (x, y, z), (u, v, w) = np.ascontiguousarray((b - a).T), np.ascontiguousarray((c - a).T)
        crosses[:, block] = y * w - z * v, z * u - x * w, x * v - y * u
    return crosses


def face_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the triangles' areas, shape (f,)."""
    crosses = face_crosses(vertices, faces)
    return np.asarray(0.5 * np.sqrt(np.square(crosses, out=crosses).sum(axis=0)))


def spread_over_faces(
    vertices: FloatArray, faces: IntArray, num: int
) -> tuple[FloatArray, IntArray]:
    """Return points (num, 3) spread over triangles evenly by area, and the triangle of each (num,)."""
    areas = face_areas(vertices, faces)
    numbers = np.arange(num)
    at = np.searchsorted(np.cumsum(areas), (numbers + 0.5) / num * areas.sum())
    at = np.minimum(at, len(areas) - 1)
    # A low-discrepancy sequence in the unit square (Roberts 2018), folded onto the triangle.
    first, second = (numbers * 0.7548776662466927) % 1.0, (numbers * 0.5698402909980532) % 1.0
    beyond = first + second > 1.0
    first, second = np.where(beyond, 1.0 - first, first), np.where(beyond, 1.0 - second, second)
    corner, one, other = np.moveaxis(vertices[faces[at]], 1, 0)
    return corner + (one - corner) * first[:, None] + (other - corner) * second[:, None], at


def vertex_components(num_vertices: int, edges: Iterable[IntArray]) -> tuple[int, IntArray]:
    """Return the number of connected components and each vertex's label, shape (v,), in the order of first vertices.

    Edges are arrays of two columns. Trees of vertices hang on smaller ones (algorithm S of Liu and Tarjan 2022).
    """
    root = np.arange(num_vertices)
    for ends in edges:
        one, other = ends.T
        while len(one):
            one, other = root[one], root[other]
            if len(apart := np.flatnonzero(one != other)) < len(one):
                one, other = one[apart], other[apart]
            np.minimum.at(root, np.maximum(one, other), np.minimum(one, other))
            while ((above := root[root]) != root).any():
                root = above
    is_root = root == np.arange(num_vertices)
    return int(is_root.sum()), (np.cumsum(is_root) - 1)[root]


def mesh_components(num_vertices: int, faces: IntArray) -> tuple[int, IntArray]:
    """Return the number of connected components of a mesh (t, 3) and each vertex's label, shape (v,).

    Vertices of no triangle are components of their own. Edges need not be known.
    """
    corners = np.ascontiguousarray(faces.T)
    return vertex_components(num_vertices, [corners[:2].T, corners[1:].T])


def is_open_surface(vertices: FloatArray, faces: IntArray) -> bool:
    """Return whether a mesh (t, 3) has a rim: a boundary long compared with its size (no small holes)."""
    if not len(faces):
        return False
    size = float(np.sqrt(face_areas(vertices, faces).sum()))
    one, other = boundary_edges(faces).T
    return (
        float(np.linalg.norm(vertices[one] - vertices[other], axis=1).sum()) > OPEN_BOUNDARY * size
    )
