"""The chirality of every surface by itself: found while it was sampled, or one job per file, kept in the store."""

from __future__ import annotations

from collalign.engine.jobs.job import Job
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.evidence.map_surfaces import wanted_file
from data_tools.embedding.chirality import (
    NO_CHIRALITY,
    SurfaceChirality,
    surface_chirality,
)
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import CleaningOptions

#: Shapes of a larger collection that the pilot looks at: a side with a twentieth of the shapes is among so many.
MOST_SHAPES = 150


def chirality_of_file(
    path: Origin, name: str, digest: str, cleaning: CleaningOptions
) -> SurfaceChirality:
    """Measure one surface, unless its file has changed since its digest was taken; runs inside a worker."""
    return surface_chirality(read_shape(path, cleaning, name=name, digest=digest))


#: Measures a surface. The version changes whenever the same file would give another result.
MEASURING = Job(
    kind="surfaces", version="chirality-2", run=chirality_of_file, reader=SurfaceChirality
)


def measure_surfaces(session: AlignSession, shapes: Shapes) -> list[SurfaceChirality]:
    """Return the chirality of every surface, :data:`NO_CHIRALITY` of those that cannot be measured.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    """
    every = range(len(shapes.names))
    known = {i: found for i, found in enumerate(shapes.chirality) if found is not None}
    wanted = {i: wanted_file(MEASURING, session, shapes, i) for i in every if i not in known}
    limit_s = session.run.shape_time_limit_s
    found = known | dict(session.compute(MEASURING, wanted, time_limit_s=limit_s))
    return [found.get(i, NO_CHIRALITY) for i in every]
