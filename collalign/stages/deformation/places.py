"""Where every vertex of a shape belongs on the reference: by common functions, then on the fitted reference."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from collalign.nonrigid.functional_map import FunctionalMap, fitted_map, mutual_nearest_rows
from collalign.nonrigid.map_options import NonrigidOptions
from collalign.nonrigid.portfolio import refined_with_evidence, trust_of, with_others_from_poses
from collalign.nonrigid.pose_maps import PoseMapper
from collalign.registration.by_map import MapGoals, fitted_by_map
from collalign.stages.deformation.map_jobs import VertexSurface
from collalign.stages.evidence.map_surfaces import StoredSurface
from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape

#: Origin of the map that a collection asks for.
_CONSISTENT = "collection"


def places_on_reference(
    reference: VertexSurface,
    shape: VertexSurface,
    bases: FloatArray,
    samples: tuple[StoredSurface, StoredSurface],
    mirrored: bool,
) -> tuple[FloatArray, float, FloatArray]:
    """Return the places (v, 3) of a file's vertices, NaN for none, and the confidence of all and of each (v,).

    The functions say which vertices belong to each other as far as their number resolves; the reference is laid onto
    the shape by that, and each vertex belongs to the point of the laid surface that is closest to it.

    Parameters
    ----------
    reference, shape : VertexSurface
    bases : ndarray, shape (2, m, n)
        The common functions of each.
    samples : pair of StoredSurface
    mirrored : bool
        Whether one of the two is mirrored in the common frame.
    """
    to, of = _working_surface(reference), _working_surface(shape)
    if reference.name == shape.name:
        places, sure, sure_at = of.vertices, 1.0, np.ones(len(of.vertices))
    else:
        goals = _goals(of, *_vertex_maps(reference, shape, bases))
        moving = to.transformed(np.diag([1.0, 1.0, -1.0 if mirrored else 1.0, 1.0]))  # none turns inside out
        fitted = fitted_by_map(of, moving, goals)
        places = SurfaceLocator(fitted, to.faces).closest(of.vertices).on(to.vertices)
        sure, sure_at = trust_of_places(of, places, samples, mirrored=mirrored)
    every = np.column_stack([places, sure_at])
    every = np.where((shape.to_working >= 0)[:, None], every[shape.to_working], np.nan)
    return every[:, :3], sure, every[:, 3]


def trust_of_places(
    of: Shape, places: FloatArray, samples: tuple[StoredSurface, StoredSurface], *, mirrored: bool
) -> tuple[float, FloatArray]:
    """Return the confidence of places (w, 3) of all working vertices, and of each: theirs among maps from poses."""
    mapper = PoseMapper(samples[0].posed, (samples[1].mirrored if mirrored else samples[1]).posed)
    target, source = mapper.target.spectral, mapper.source.spectral
    placed = places[cKDTree(of.vertices).query(samples[1].vertices)[1]]
    forward, backward = (cKDTree(a).query(b)[1] for a, b in ((target.vertices, placed), (placed, target.vertices)))
    c = fitted_map(target.basis, source.basis, forward, backward)
    own = FunctionalMap(C_source_target=c, map_target_source=forward, map_source_target=backward)
    found = with_others_from_poses(mapper, refined_with_evidence(target, source, own, _CONSISTENT), NonrigidOptions())
    sure, at_samples = trust_of(target, source, found)
    return sure, at_samples[cKDTree(samples[1].vertices).query(of.vertices)[1]]


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
