"""Where every vertex of a shape belongs on the reference: by common functions, then on the fitted reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collalign.engine.jobs.run import SharedTable
from collalign.engine.store.records import Record
from collalign.nonrigid.functional_map import mutual_nearest_rows
from collalign.registration.fit import fitted_by_map
from collalign.registration.pieces import MapGoals
from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class VertexTask:
    """Two surfaces of the shared table and their common bases; the first is the reference."""

    reference: str
    surface: str
    bases: FloatArray


def places_on_reference(task: VertexTask, shared: SharedTable) -> Record:
    """Return the ``places`` (v, 3) of a file's vertices on the reference, NaN for none; runs inside a worker.

    The functions say which vertices belong to each other as far as their number resolves; the reference is laid onto
    the shape by that, and each vertex belongs to the point of the laid surface that is closest to it.
    """
    reference, shape = (_working_surface(shared[key], key) for key in (task.reference, task.surface))
    if task.reference == task.surface:
        places = shape.vertices
    else:
        goals = _goals(shape, *_vertex_maps(task, shared))
        fitted = fitted_by_map(shape, reference, goals)
        places = SurfaceLocator(fitted, reference.faces).closest(shape.vertices).on(reference.vertices)
    to_working = shared[task.surface]["to_working"]
    return {"places": np.where((to_working >= 0)[:, None], places[to_working], np.nan)}


def _working_surface(record: Record, key: str) -> Shape:
    return Shape.from_arrays(record["working_vertices"], record["working_faces"].astype(np.int64), name=key)


def _vertex_maps(task: VertexTask, shared: SharedTable) -> tuple[IntArray, IntArray]:
    """Return the reference's vertex nearest to each of the shape in the common functions, and the other way."""
    of_reference, of_shape = (
        np.asarray(shared[key]["basis"][:, : task.bases.shape[-1]], dtype=np.float64) @ basis
        for key, basis in zip((task.reference, task.surface), task.bases, strict=True)
    )
    return mutual_nearest_rows(of_reference, of_shape)


def _goals(shape: Shape, to_reference: IntArray, from_reference: IntArray) -> MapGoals:
    """Return where both maps take the reference's vertices."""
    return MapGoals(
        vertices=np.concatenate([np.arange(len(from_reference)), to_reference]),
        places=np.concatenate([shape.vertices[from_reference], shape.vertices]),
    )
