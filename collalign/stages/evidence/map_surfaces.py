"""The surface stage: the meshes of a collection prepared for maps that start from poses, one job per shape."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated

from collalign.engine.job import Job, Results
from collalign.nonrigid.pose_maps import (
    PosedSurface,
    posed_surface,
    prepare_posed,
    spectral_samples,
)
from collalign.nonrigid.spectral_shape import SpectralShape
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.shape_stage import compute_surfaces, wanted_file
from data_tools.arrays import FloatArray, Holds
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import CleaningOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredSurface:
    """A surface at its dense samples, with fields of :class:`collalign.nonrigid.spectral_shape.SpectralShape`."""

    name: str
    vertices: Annotated[FloatArray, Holds(shape="n 3")]
    normals: Annotated[FloatArray, Holds(shape="n 3")]
    area: Annotated[float, Holds(positive=True)]
    eigenvalues: Annotated[FloatArray, Holds(shape="m")]
    functions: Annotated[FloatArray, Holds(shape="n m")]
    mass: Annotated[FloatArray, Holds(shape="n")]
    agd: Annotated[FloatArray, Holds(shape="n")]
    curvature: Annotated[FloatArray, Holds(shape="n _")]
    orientation: Annotated[FloatArray, Holds(shape="n _ _")]

    @classmethod
    def of(cls, spectral: SpectralShape, normals: FloatArray) -> StoredSurface:
        """Return the surface of a shape that is known at its dense samples only, with their normals (s, 3)."""
        return cls(normals=normals, **{name: getattr(spectral, name) for name in OF_SPECTRAL})

    @cached_property
    def spectral(self) -> SpectralShape:
        """The surface as maps need it."""
        return spectral_samples(**{name: getattr(self, name) for name in OF_SPECTRAL})

    @cached_property
    def posed(self) -> PosedSurface:
        """The surface as maps from poses need it."""
        return posed_surface(self.spectral, self.normals)


#: Fields that a prepared shape has as well.
OF_SPECTRAL = tuple(field.name for field in fields(StoredSurface) if field.name != "normals")


def prepare_surface_file(
    path: Origin, name: str, digest: str, cleaning: CleaningOptions
) -> StoredSurface:
    """Read and prepare one surface, unless it has changed since its digest was taken; runs inside a worker."""
    surface = prepare_posed(read_shape(path, cleaning, name=name, digest=digest))
    return StoredSurface.of(surface.spectral, surface.normals)


#: Prepares a surface. The version changes whenever the same file would give another one.
PREPARING = Job(
    kind="surfaces", version="surface-3", run=prepare_surface_file, reader=StoredSurface
)


def prepare_surfaces(session: AlignSession, shapes: Shapes) -> Results[int, StoredSurface]:
    """Prepare the surfaces that the store lacks, and return all that could be prepared, by position of the shape.

    Point clouds have none, nor have meshes of very few vertices.
    """
    wanted = {i: wanted_file(PREPARING, session, shapes, i) for i in range(len(shapes.names))}
    return compute_surfaces(PREPARING, session, shapes, wanted)
