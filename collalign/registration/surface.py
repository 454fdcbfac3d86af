"""A surface made ready for registration, and which vertices of a mean lie where a shape has nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from collalign.registration.tuning import TUNED
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.surface_points import MAX_DEFECTS, cloud_rim, plane_normals
from data_tools.poses import moved_by, scales_of
from data_tools.surface.closest import SurfaceLocator, lies_beyond
from data_tools.surface.shape import Shape, outward_normals, vertex_normals
from data_tools.surface.topology import boundary_edges


@dataclass(frozen=True, kw_only=True, eq=False)
class RegistrationSurface:
    """A posed mesh or point cloud. Build it with :meth:`from_shape`.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Oriented so that normals point outwards; empty for a cloud.
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
        return replace(
            self, vertices=read_only(moved_by(pose, self.vertices)), radius=scale * self.radius
        )

    @cached_property
    def locator(self) -> SurfaceLocator:
        """Finds closest points."""
        return SurfaceLocator(self.vertices, self.faces)

    def normals(self, vertices: FloatArray) -> FloatArray:
        """Return the normals with the vertices elsewhere, shape (v, 3); zeros where there are none."""
        return vertex_normals(vertices, self.faces) if self.oriented else np.zeros_like(vertices)


#: What a shape has counts fully at so many radii from what it lacks, and less towards it: a mean in which a shape
#: ends abruptly would have a step there.
RAMP = 0.2


def with_cloud_rim(surface: RegistrationSurface) -> RegistrationSurface:
    """Return a surface whose rim is known as well where it is a point cloud."""
    if len(surface.faces):
        return surface
    normals = plane_normals(surface.vertices, surface.vertices)
    return replace(surface, on_rim=read_only(cloud_rim(surface.vertices, normals)))


def missing_vertices(target: RegistrationSurface, vertices: FloatArray) -> BoolArray:
    """Return which vertices, registered to a target that lacks parts, lie where it has nothing, shape (v,).

    Parameters
    ----------
    target : RegistrationSurface
        With its rim, see :func:`with_cloud_rim`.
    vertices : ndarray, shape (v, 3)
    """
    return lies_beyond(*nearest_on(target, vertices), target.radius)


def nearest_on(target: RegistrationSurface, vertices: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return distances (v,) of vertices to the nearest point of a target, and whether it is on its rim, (v,)."""
    places = target.locator.closest(vertices)
    on_rim = np.asarray((target.on_rim[places.corners] | (places.weights <= 0.0)).all(axis=1))
    return np.linalg.norm(places.on(target.vertices) - vertices, axis=1), on_rim


def mean_of_what_is_there(
    copies: Sequence[FloatArray], missing: Sequence[BoolArray], source: FloatArray, radius: float
) -> FloatArray:
    """Return the mean surface of registered copies, of which each counts where its shape has something, shape (v, 3).

    Parameters
    ----------
    copies : sequence of ndarray, shape (v, 3)
    missing : sequence of ndarray of bool, shape (v,)
    source : ndarray, shape (v, 3)
        What was registered; where nothing is there, it stays.
    radius : float
        Of the source.
    """
    if not any(lacks.any() for lacks in missing):
        return np.asarray(np.mean(copies, axis=0))
    weights = np.ones((len(copies), len(source)))
    for row, lacks in zip(weights, missing, strict=True):
        if lacks.any():
            row[:] = np.minimum(cKDTree(source[lacks]).query(source)[0] / (RAMP * radius), 1.0)
    total = weights.sum(axis=0)
    mean = np.einsum("nv,nvd->vd", weights / np.where(total > 0, total, 1.0), np.stack(copies))
    return np.where((total > 0)[:, None], mean, source)
