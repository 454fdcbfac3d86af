"""Surfaces prepared in full for maps of all their vertices, one job per shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from collalign.engine.jobs.job import Job, Results, Wanted
from collalign.engine.store.records import Record, to_record
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.posed_surface import sampled_surface
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.evidence.map_surfaces import StoredSurface
from data_tools.arrays import FloatArray, Holds, IntArray
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED


@dataclass(frozen=True, kw_only=True, eq=False)
class VertexSurface:
    """A surface at all its working vertices.

    Attributes
    ----------
    name : str
    basis : ndarray of float32, shape (w, m + 1)
        Functions at the working vertices, the constant one first.
    working_vertices : ndarray, shape (w, 3)
    working_faces : ndarray of int, shape (f, 3)
    to_working : ndarray of int, shape (v,)
        The working vertex of each vertex of the file, -1 for none.
    """

    name: str
    basis: Annotated[NDArray[np.float32], Holds(shape="w _")]
    working_vertices: Annotated[FloatArray, Holds(shape="w 3")]
    working_faces: Annotated[IntArray, Holds(shape="_ 3")]
    to_working: Annotated[IntArray, Holds(shape="_", lower=-1)]


def prepare_detailed(path: Origin, name: str, digest: str, options: SurfaceOptions) -> Record:
    """Read and prepare one surface, unless it has changed since its digest was taken; runs inside a worker.

    Returns
    -------
    dict
        The fields of :class:`collalign.stages.evidence.map_surfaces.StoredSurface` and of :class:`VertexSurface`.
    """
    shape = read_shape(path, AS_STORED, name=name, digest=digest)
    if not shape.is_mesh:
        raise InputError(f"{shape.file or shape.name}: maps of all vertices need a mesh")
    prepared = prepare_surface(shape, options)
    sampled = sampled_surface(prepared)
    at_vertices = VertexSurface(
        name=name,
        basis=prepared.basis.astype(np.float32),
        working_vertices=prepared.vertices,
        working_faces=prepared.faces.astype(np.int32),
        to_working=prepared.to_working.astype(np.int32),
    )
    return to_record(StoredSurface.of(sampled.spectral, sampled.normals)) | to_record(at_vertices)


#: Prepares a surface in full. The version changes whenever the same file would give another one.
DETAILING = Job(kind="surfaces", version="detailed-6", run=prepare_detailed, reader=StoredSurface)


def prepare_all_detailed(
    session: AlignSession, shapes: Shapes, options: SurfaceOptions
) -> Results[int, StoredSurface]:
    """Prepare the surfaces that the store lacks, and return them by position of the shape."""
    wanted = {
        i: Wanted(
            key=DETAILING.key({"options": options, "name": name}, digest),
            label=name,
            arguments={"path": path, "name": name, "digest": digest, "options": options},
        )
        for i, (name, path, digest) in enumerate(zip(shapes.names, shapes.files, shapes.digests, strict=True))
    }
    return session.compute(DETAILING, wanted, time_limit_s=session.run.shape_time_limit_s)
