"""Vertex normals that point outwards, where the triangles agree on a side at all."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.shape import Shape
from data_tools.surface.topology import face_crosses


def outward_normals(
    shape: Shape, *, at: IntArray | None = None, max_defects: float = 0.0
) -> FloatArray:
    """Return unit vertex normals, area-weighted over the triangles, shape (v, 3) or (k, 3).

    They point away from the inside: all are turned round where the signed volume over the centroid is negative, as in
    meshes that are inside out. Empty, shape (0, 3), where the shape has no surface or where its triangles disagree on
    a side (an edge run through twice in the same direction), since normals of random signs are worse than none.

    Parameters
    ----------
    shape : Shape
    at : ndarray of int, shape (k,), optional
        The vertices that matter, by default all.
    max_defects : float
        Share of edges that may be run through twice in the same direction; decimation leaves a few such.
    """
    if not shape.is_mesh or orientation_defects(shape) > max_defects:
        return np.empty((0, 3))
    arms = shape.vertices - shape.vertices.mean(axis=0)
    inside_out = np.vdot(face_crosses(arms, shape.faces), arms.T[:, shape.faces[:, 0]]) < 0
    faces = shape.faces[:, ::-1] if inside_out else shape.faces
    if at is None:
        return vertex_normals(shape.vertices, faces)
    matters = np.zeros(len(shape.vertices), dtype=np.bool_)
    matters[at] = True
    return vertex_normals(shape.vertices, faces[matters[faces].any(axis=1)])[at]


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return unit vertex normals on the side from which triangles turn left, shape (v, 3); zero where there are none.

    Triangles count by their area.
    """
    at, each = faces.T.ravel(), np.tile(face_crosses(vertices, faces), 3)
    normals = np.stack(
        [np.bincount(at, weights=axis, minlength=len(vertices)) for axis in each], axis=1
    )
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1.0))


def orientation_defects(shape: Shape) -> float:
    """Return the share of directed edges that more than one triangle runs through: 0 where all agree on a side."""
    keys = np.sort((shape.faces * len(shape.vertices) + np.roll(shape.faces, -1, axis=1)).ravel())
    return float((keys[1:] == keys[:-1]).sum() / len(keys))
