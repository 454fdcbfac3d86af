"""Which vertices of a registered mean lie where a shape has nothing, and means over what is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from collalign.registration.surface import RegistrationSurface
from data_tools.arrays import BoolArray, FloatArray, read_only
from data_tools.embedding.surface_points import cloud_rim, plane_normals
from data_tools.surface.closest import lies_beyond

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
    places = target.locator.closest(vertices)
    on_rim = np.asarray((target.on_rim[places.corners] | (places.weights <= 0.0)).all(axis=1))
    distances = np.linalg.norm(places.on(target.vertices) - vertices, axis=1)
    return lies_beyond(distances, on_rim, target.radius)


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
