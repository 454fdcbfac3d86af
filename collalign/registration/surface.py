"""A surface made ready for registration, the numbers in use, and which vertices of a mean lie where nothing is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only, rms_length
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.surface_points import cloud_rim, plane_normals
from data_tools.poses import moved_by, scales_of
from data_tools.surface.closest import SurfaceLocator, lies_beyond
from data_tools.surface.shape import MAX_DEFECTS, Shape, outward_normals, vertex_normals
from data_tools.surface.topology import boundary_edges


class RegistrationTuning(NamedTuple):
    """Numbers of a registration; lengths are in parts of the shapes' root mean square radius.

    Chosen on eight mouse skulls and sixteen molars, by how well their landmarks carry each other's places over from
    the landmarks' own poses, those of the pose on ten skulls, by how near it is to that of the landmarks; quoted
    figures are of other specimens. ``python -m experiments calibrate registration`` tries other values of each on
    four specimens of either kind, and on each kind what is best on the other.
    """

    num_centres: int = 600
    """Farthest points of the source at which the Gaussians stand that a deformation is made of."""
    num_points: int = 2500
    """Farthest points of each shape whose closest point on the other pulls."""
    widths: tuple[float, ...] = (0.6, 0.3)
    """Of the Gaussians. Adding .15 follows detail that landmarks do not."""
    amplitudes: tuple[float, ...] = (0.15, 0.09)
    """Standard deviation of a displacement that each width is expected to need."""
    noise: tuple[float, ...] = (0.06, 0.045, 0.03, 0.02, 0.015, 0.01, 0.01, 0.01)
    """How far correspondences are trusted, one value per iteration: coarse deformations first."""
    normal_noise: float = 0.03
    """How far normals are trusted: a difference of normals of this length counts as much as a distance of the
    iteration's noise. So normals choose the slope of a cusp at first, and positions decide at last."""
    min_cosine: float = 0.3
    """Correspondences of normals that differ by more than this cosine says do not count."""
    tangential: float = 0.5
    """Share of a correspondence's offset along the target's surface that pulls; 0 lets points slide freely. Molars
    err least at .7 and more below .4; skulls do not care between .2 and .4."""
    cutoff: float = 3.0
    """Correspondences beyond so many times the median distance, or the noise where that is more, do not count."""
    num_independent: int = 60
    """However many correspondences there are, they weigh like so many independent ones: neighbours say the same. With
    6000, nine of ten pairs of molars fold and skulls err 5 % more; from 400 to 60 nothing changes but fewer folds."""
    num_compared: int = 4
    """Iterations after which the pose of less energy is kept. After fewer, closest points that slid look as good."""
    num_compared_points: int = 1000
    """Farthest points of each shape that pull until then: they say enough of a coarse deformation."""
    num_pose_points: int = 800
    """Farthest points of each surface that settle the pose."""
    pose_noise: tuple[float, ...] = (0.06,) * 3 + (0.03,) * 9
    """How far correspondences are trusted on the way to the pose."""
    pose_cutoff: float = 6.0
    """As ``cutoff``, while the pose settles; 3 leaves sizes of skulls .1 % worse and rotations .03 deg."""


#: The numbers of a registration that are in use.
TUNED = RegistrationTuning()


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
            radius=rms_length(centred),
        )

    def placed(self, pose: FloatArray) -> RegistrationSurface:
        """Return the surface where a similarity, shape (4, 4), takes it."""
        scale = float(scales_of(pose))
        return replace(
            self, vertices=read_only(moved_by(pose, self.vertices)), radius=scale * self.radius
        )

    def with_fewer(self, num_points: int) -> RegistrationSurface:
        """Return the surface with fewer farthest points."""
        return replace(self, spread=self.spread[:num_points])

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
            row[:] = np.minimum(
                scipy.spatial.cKDTree(source[lacks]).query(source)[0] / (RAMP * radius), 1.0
            )
    total = weights.sum(axis=0)
    mean = np.einsum("nv,nvd->vd", weights / np.where(total > 0, total, 1.0), np.stack(copies))
    return np.where((total > 0)[:, None], mean, source)
