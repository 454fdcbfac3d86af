"""Surfaces prepared in full for maps of all their vertices, one job per shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collalign.engine.jobs.run import SharedTable
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.nonrigid.options import SurfaceOptions
from collalign.nonrigid.surface.geometry import vertex_normals
from collalign.nonrigid.surface.spectral import prepare_surface
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.evidence.surfaces import SURFACE_ROWS
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED

#: Changes whenever the same file would give another surface.
DETAILED_VERSION = "detailed-2"
#: Fields that maps of samples do not need: per vertex, and large.
_OF_VERTICES = ("basis", "to_working", "working_vertices", "working_faces")


@dataclass(frozen=True, kw_only=True)
class DetailTask:
    """What a worker needs to prepare one surface; a file that has changed since its digest was taken is refused."""

    path: Origin
    name: str
    digest: str
    options: SurfaceOptions


def prepare_detailed(task: DetailTask) -> Record:
    """Read and prepare one surface; runs inside a worker.

    Returns
    -------
    dict
        What :func:`collalign.stages.evidence.surfaces.surface_from_record` reads, at the dense samples; ``basis``
        (w, m + 1) at all working vertices in single precision, the working surface, and its vertex for each of the
        file's.
    """
    shape = read_shape(task.path, AS_STORED, name=task.name, digest=task.digest)
    if not shape.is_mesh:
        raise InputError(f"{shape.file or shape.name}: maps of all vertices need a mesh")
    prepared = prepare_surface(shape, task.options)
    dense = prepared.dense
    rows = {name: getattr(prepared, name)[dense] for name in SURFACE_ROWS if name != "orientation"}
    return rows | {
        "orientation": prepared.orientation,
        "mass": rows["mass"] / rows["mass"].sum(),
        "vertices": prepared.vertices[dense],
        "normals": vertex_normals(prepared.working_shape)[dense],
        "eigenvalues": prepared.eigenvalues,
        "area": float(prepared.area),
        "basis": prepared.basis.astype(np.float32),
        "to_working": prepared.to_working.astype(np.int32),
        "working_vertices": prepared.vertices,
        "working_faces": prepared.faces.astype(np.int32),
    }


def prepare_all_detailed(
    session: AlignSession, shapes: Shapes, options: SurfaceOptions
) -> tuple[list[str], dict[int, str]]:
    """Prepare the surfaces that the store lacks; return the keys of all shapes, and why some have no surface."""
    keys = [
        fingerprint(DETAILED_VERSION, {"options": options, "name": name}, digest)
        for name, digest in zip(shapes.names, shapes.digests, strict=True)
    ]
    failures = session.compute(
        "surfaces",
        prepare_detailed,
        {
            key: (name, DetailTask(path=path, name=name, digest=digest, options=options))
            for key, name, path, digest in zip(keys, shapes.names, shapes.files, shapes.digests, strict=True)
        },
        time_limit_s=session.run.shape_time_limit_s,
    )
    return keys, {i: failures[key].reason for i, key in enumerate(keys) if key in failures}


def table_of_samples(session: AlignSession, shapes: Shapes, keys: dict[int, str]) -> SharedTable:
    """Return a table of what the maps of samples need, by key of the surface and of the shape's own record."""
    records = ((key, session.store.require("surfaces", key)) for key in keys.values())
    slim = (
        (key, {name: value for name, value in record.items() if name not in _OF_VERTICES}) for key, record in records
    )
    own = ((shapes.keys[i], session.store.require("shapes", shapes.keys[i])) for i in keys)
    return SharedTable.create((*slim, *own))


def table_of_vertices(session: AlignSession, keys: dict[int, str]) -> SharedTable:
    """Return a table of the surfaces and the functions at all their vertices, by key of the surface."""
    records = ((key, session.store.require("surfaces", key)) for key in keys.values())
    return SharedTable.create((key, {name: record[name] for name in _OF_VERTICES}) for key, record in records)
