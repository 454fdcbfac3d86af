"""Closest points on a triangle mesh or a point cloud, exactly, carried along when it moves; places beyond its rim."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from data_tools.surface.triangle_tree import TriangleTree

#: A place lies beyond a surface if the nearest one on the surface is on its rim and farther than the first of these,
#: or farther than the second wherever it is; in root mean square radii of the surface.
BEYOND_RIM, FAR = 0.05, 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Places on a surface.

    Attributes
    ----------
    corners : ndarray of int, shape (q, 3)
        Vertices of the triangle that each place lies on; three times the same vertex on a cloud.
    weights : ndarray, shape (q, 3)
        Barycentric coordinates: not negative, each row sums to one.
    """

    corners: IntArray
    weights: FloatArray

    @property
    def nearest(self) -> IntArray:
        """The corner of the largest weight, shape (q,)."""
        return np.asarray(self.corners[np.arange(len(self.corners)), self.weights.argmax(axis=1)])

    def on(self, vertices: FloatArray) -> FloatArray:
        """Return the places on the same mesh with its vertices elsewhere, shape (q, 3)."""
        return np.asarray(np.einsum("qc,qcd->qd", self.weights, vertices[self.corners]))


class SurfaceLocator:
    """Finds closest points of one surface.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Empty for a point cloud, of which the closest point is a vertex.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self.vertices = vertices
        self.faces = (
            faces if len(faces) else np.repeat(np.arange(len(vertices))[:, None], 3, axis=1)
        )

    @cached_property
    def _tree(self) -> TriangleTree:
        from data_tools.surface.triangle_tree import triangle_tree

        return triangle_tree(self.vertices, self.faces)

    def closest(self, points: FloatArray) -> SurfacePoints:
        """Return the closest place to each of the points (q, 3); of triangles that are equally near, on the first."""
        from data_tools.surface.triangle_tree import closest_triangles

        # A copy: of an array that must not be written Numba would compile another version.
        given = np.array(points, dtype=np.float64, order="C")
        triangles, weights = closest_triangles(self._tree, given)
        return SurfacePoints(corners=self.faces[triangles], weights=weights)


def lies_beyond(distances: FloatArray, on_rim: BoolArray, radius: float) -> BoolArray:
    """Return which places lie where a surface has nothing, by what is nearest to them.

    Parameters
    ----------
    distances : ndarray, shape (q,)
        From each place to the nearest one of the surface.
    on_rim : ndarray of bool, shape (q,)
        Whether that is on the surface's rim.
    radius : float
        Root mean square radius of the surface.
    """
    return np.asarray(distances > radius * np.where(on_rim, BEYOND_RIM, FAR))
