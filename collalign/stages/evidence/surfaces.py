"""The surface stage: the meshes of a collection prepared for maps that start from poses, one job per shape."""

from __future__ import annotations

from dataclasses import dataclass

from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.nonrigid.surface.posed import PosedSurface, posed_surface, prepare_posed, spectral_samples
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.record_fields import checked
from data_tools.arrays import as_floats, as_points, read_only
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import CleaningOptions

#: Changes whenever the same file would give another surface.
SURFACE_VERSION = "surface-1"
#: Fields of a record, with one row for each dense sample.
SURFACE_ROWS = ("functions", "mass", "agd", "curvature", "orientation")


@dataclass(frozen=True, kw_only=True)
class SurfaceTask:
    """What a worker needs to prepare one surface; a file that has changed since its digest was taken is refused."""

    path: Origin
    name: str
    digest: str
    cleaning: CleaningOptions


def prepare_surface_file(task: SurfaceTask) -> Record:
    """Read and prepare one surface; runs inside a worker."""
    surface = prepare_posed(read_shape(task.path, task.cleaning, name=task.name, digest=task.digest))
    spectral = surface.spectral
    rows = {name: getattr(spectral, name) for name in SURFACE_ROWS}
    return rows | {
        "vertices": spectral.vertices,
        "normals": surface.normals,
        "eigenvalues": spectral.eigenvalues,
        "area": float(spectral.area),
    }


def surface_from_record(record: Record, name: str) -> PosedSurface:
    """Check a record and return the surface.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with checked(f"surface of {name}"):
        vertices = as_points(record["vertices"], "vertices", dim=3)
        values = as_floats(record["eigenvalues"], "eigenvalues", shape=(None,))
        num, size = len(vertices), len(values)
        area = float(record["area"])
        if not 0 < area < float("inf"):
            raise InputError(f"area: expected a positive number, got {area}")
        orientation = as_floats(record["orientation"], "orientation", shape=(num, None, None))
        spectral = spectral_samples(
            name=name,
            vertices=vertices,
            area=area,
            eigenvalues=values,
            functions=as_floats(record["functions"], "functions", shape=(num, size)),
            mass=as_floats(record["mass"], "mass", shape=(num,)),
            agd=as_floats(record["agd"], "agd", shape=(num,)),
            curvature=as_floats(record["curvature"], "curvature", shape=(num, None)),
            orientation=orientation,
        )
        return posed_surface(spectral, read_only(as_floats(record["normals"], "normals", shape=(num, 3))))


def prepare_surfaces(session: AlignSession, shapes: Shapes) -> dict[int, str]:
    """Prepare the surfaces that the store lacks, and return the keys of all that could be prepared, by shape.

    Point clouds have none, nor have meshes of very few vertices.
    """
    cleaning = session.options.cleaning
    keys = [fingerprint(SURFACE_VERSION, {}, key) for key in shapes.keys]
    failures = session.compute(
        "surfaces",
        prepare_surface_file,
        {
            key: (name, SurfaceTask(path=path, name=name, digest=digest, cleaning=cleaning))
            for key, name, path, digest in zip(keys, shapes.names, shapes.files, shapes.digests, strict=True)
        },
        time_limit_s=session.run.shape_time_limit_s,
    )
    return {i: key for i, key in enumerate(keys) if key not in failures}
