"""How surfaces in dense correspondence vary: superimposed shapes, their mean, principal components and offsets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collalign.analysis.procrustes import (
    PrincipalComponents,
    centroid_sizes,
    generalized_procrustes,
    principal_components,
)
from collalign.tools.variation.surface_quality import SurfaceQuality
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.notes import Note
from data_tools.surface.normals import vertex_normals
from data_tools.threads import one_blas_thread

#: Components that are shown and written.
NUM_COMPONENTS = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceVariation:
    """Surfaces of one triangulation, superimposed. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str, length N
    faces : ndarray of int, shape (f, 3)
    mean : ndarray, shape (v, 3)
        Lengths are in the root mean square radius of a shape.
    shapes : ndarray, shape (N, v, 3)
        Of unit size, rotated and shifted to fit the mean best.
    centroid_sizes : ndarray, shape (N,)
        Square root of the summed squared distances of all vertices from their centroid, in the unit of the vertices
        given.
    components : PrincipalComponents
        Of the shapes.
    quality : SurfaceQuality or None
        How well each specimen is represented; None where only surfaces in correspondence were given.
    notes : tuple of Note
        What a reader must know of who counts and what was tested.
    """

    names: tuple[str, ...]
    faces: IntArray
    mean: FloatArray
    shapes: FloatArray
    centroid_sizes: FloatArray
    components: PrincipalComponents
    quality: SurfaceQuality | None = None
    notes: tuple[Note, ...] = ()


@one_blas_thread()
def surface_variation(names: Sequence[str], faces: IntArray, vertices: FloatArray) -> SurfaceVariation:
    """Superimpose surfaces and find their principal components.

    Parameters
    ----------
    names : sequence of str, length N
    faces : ndarray of int, shape (f, 3)
    vertices : ndarray, shape (N, v, 3)
        At least two surfaces, complete: row ``b`` of each is the same place.

    Raises
    ------
    InputError
        If there are fewer than two surfaces, or vertices are missing.
    """
    shapes = float(np.sqrt(vertices.shape[1])) * generalized_procrustes(vertices)
    components = principal_components(shapes)
    return SurfaceVariation(
        names=tuple(names),
        faces=faces,
        mean=components.mean,
        shapes=read_only(shapes),
        centroid_sizes=read_only(centroid_sizes(vertices)),
        components=components,
    )


def signed_offsets(surface: FloatArray, faces: IntArray, other: FloatArray) -> FloatArray:
    """Return how far another surface lies outside of one at every vertex, negative inside, shape (v,).

    Parameters
    ----------
    surface, other : ndarray, shape (v, 3)
        In correspondence.
    faces : ndarray of int, shape (f, 3)
        Oriented so that normals point outwards; without faces, distances are returned.
    """
    moved = other - surface
    if not len(faces):
        return np.asarray(np.linalg.norm(moved, axis=1))
    return np.asarray((moved * vertex_normals(surface, faces)).sum(axis=1))


def group_means(shapes: FloatArray, labels: Sequence[str]) -> dict[str, FloatArray]:
    """Return the mean surface of every label that is not empty, in alphabetical order, each (v, 3)."""
    kinds = sorted(set(labels) - {""})
    return {kind: shapes[[label == kind for label in labels]].mean(axis=0) for kind in kinds}
