"""Where every vertex of a shape belongs on the reference: by common functions, then on the fitted reference."""

from __future__ import annotations

import numpy as np

from collalign.nonrigid.functional_map import mutual_nearest_rows
from collalign.registration.fit import fitted_by_map
from collalign.registration.pieces import MapGoals
from collalign.stages.deformation.dense_surfaces import VertexSurface
from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape


def places_on_reference(reference: VertexSurface, shape: VertexSurface, bases: FloatArray) -> FloatArray:
    """Return the places (v, 3) of a file's vertices on the reference, NaN for none; runs inside a worker.

    The functions say which vertices belong to each other as far as their number resolves; the reference is laid onto
    the shape by that, and each vertex belongs to the point of the laid surface that is closest to it.

    Parameters
    ----------
    reference, shape : VertexSurface
    bases : ndarray, shape (2, m, n)
        The common functions of each.
    """
    to, of = _working_surface(reference), _working_surface(shape)
    if reference.name == shape.name:
        places = of.vertices
    else:
        goals = _goals(of, *_vertex_maps(reference, shape, bases))
        fitted = fitted_by_map(of, to, goals)
        places = SurfaceLocator(fitted, to.faces).closest(of.vertices).on(to.vertices)
    return np.where((shape.to_working >= 0)[:, None], places[shape.to_working], np.nan)


def _working_surface(surface: VertexSurface) -> Shape:
    return Shape.from_arrays(surface.working_vertices, surface.working_faces, name=surface.name)


def _vertex_maps(reference: VertexSurface, shape: VertexSurface, bases: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the reference's vertex nearest to each of the shape in the common functions, and the other way."""
    of_reference, of_shape = (
        np.asarray(surface.basis[:, : bases.shape[-1]], dtype=np.float64) @ basis
        for surface, basis in zip((reference, shape), bases, strict=True)
    )
    return mutual_nearest_rows(of_reference, of_shape)


def _goals(shape: Shape, to_reference: IntArray, from_reference: IntArray) -> MapGoals:
    """Return where both maps take the reference's vertices."""
    vertices = np.concatenate([np.arange(len(from_reference)), to_reference])
    return vertices, np.concatenate([shape.vertices[from_reference], shape.vertices])
