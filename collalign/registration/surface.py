"""A surface made ready for registration: normals, rim, farthest points, and a size to measure by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from collalign.registration.tuning import TUNED
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.surface_points import MAX_DEFECTS
from data_tools.poses import moved_by, scales_of
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.normals import outward_normals, vertex_normals
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges


@dataclass(frozen=True, kw_only=True, eq=False)
class RegistrationSurface:
    """A posed mesh or point cloud. Build it with :meth:`from_shape`.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Turned so that normals point outwards; empty for a cloud.
    oriented : bool
        Whether there are normals; without them only positions are compared.
    on_rim : ndarray of bool, shape (v,)
        Vertices of the mesh's boundary: a closest point there may lie beyond it.
    spread : ndarray of int, shape (p,)
        Farthest points in the order of choice.
    radius : float
        Root mean square distance of the spread points from their centroid: the unit of lengths in a registration.
    """

    vertices: FloatArray
    faces: IntArray
    oriented: bool
    on_rim: BoolArray
    spread: IntArray
    radius: float

    @classmethod
    def from_shape(cls, shape: Shape, num_points: int = TUNED.num_points) -> RegistrationSurface:
        """Prepare a shape, of which at most ``num_points`` farthest points pull and are pulled."""
        normals = outward_normals(shape, max_defects=MAX_DEFECTS)
        faces, oriented = shape.faces, len(normals) > 0
        if oriented and (normals * vertex_normals(shape.vertices, faces)).sum() < 0:
            faces = np.ascontiguousarray(faces[:, ::-1])
        on_rim = np.zeros(len(shape.vertices), dtype=bool)
        on_rim[boundary_edges(faces).ravel()] = True
        distinct = len(np.unique(shape.vertices, axis=0))
        spread = farthest_points(shape, min(num_points, distinct), metric="euclidean")
        centred = shape.vertices[spread] - shape.vertices[spread].mean(axis=0)
        return cls(
            vertices=shape.vertices,
            faces=read_only(faces),
            oriented=oriented,
            on_rim=read_only(on_rim),
            spread=spread,
            radius=float(np.sqrt((centred**2).sum(axis=1).mean())),
        )

    def placed(self, pose: FloatArray) -> RegistrationSurface:
        """Return the surface where a similarity, shape (4, 4), takes it."""
        scale = float(scales_of(pose))
        return replace(self, vertices=read_only(moved_by(pose, self.vertices)), radius=scale * self.radius)

    @cached_property
    def locator(self) -> SurfaceLocator:
        """Finds closest points."""
        return SurfaceLocator(self.vertices, self.faces)

    def normals(self, vertices: FloatArray) -> FloatArray:
        """Return the normals with the vertices elsewhere, shape (v, 3); zeros where there are none."""
        return vertex_normals(vertices, self.faces) if self.oriented else np.zeros_like(vertices)
