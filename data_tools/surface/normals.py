"""Vertex normals that point outwards, where the triangles agree on a side at all."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.surface.shape import Shape


def outward_normals(shape: Shape) -> FloatArray:
    """Return unit vertex normals, area-weighted over the triangles, shape (v, 3).

    They point away from the inside: all are turned round where the signed volume over the centroid is negative, as in
    meshes that are inside out. Empty, shape (0, 3), where the shape has no surface or where its triangles disagree on
    a side (an edge run through twice in the same direction), since normals of random signs are worse than none.

    Parameters
    ----------
    shape : Shape
    """
    if not shape.is_mesh or not is_consistently_oriented(shape):
        return np.empty((0, 3))
    corners = shape.vertices[shape.faces] - shape.vertices.mean(axis=0)
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if (doubled * corners[:, 0]).sum() < 0:
        doubled = -doubled
    normals = np.zeros(shape.vertices.shape)
    for corner in range(3):
        np.add.at(normals, shape.faces[:, corner], doubled)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0, lengths, 1.0)


def is_consistently_oriented(shape: Shape) -> bool:
    """Return whether no two triangles run through an edge in the same direction."""
    directed = np.concatenate([shape.faces[:, [0, 1]], shape.faces[:, [1, 2]], shape.faces[:, [2, 0]]])
    keys = directed[:, 0] * len(shape.vertices) + directed[:, 1]
    return len(np.unique(keys)) == len(keys)
