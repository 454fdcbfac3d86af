"""Aligned meshes as PLY, OBJ or STL, at full resolution and with normals outwards where the pose mirrors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from collalign.tools.export.request import ExportRequest
from data_tools.io.output_folder import file_stems
from data_tools.io.shapes import write_mesh


def writer(ending: str) -> Callable[[ExportRequest], tuple[Path, ...]]:
    """Return the writer of one mesh format: ``ply``, ``obj`` or ``stl``."""

    def write(request: ExportRequest) -> tuple[Path, ...]:
        """Write ``NAME.<ending>`` per shape, one shape in memory at a time."""
        transforms = request.transforms()
        stems = file_stems(request.collection.names)
        return tuple(
            write_mesh(request.path(f"{stem}.{ending}"), request.source_shape(at).transformed(transforms[at]))
            for at, stem in enumerate(stems)
        )

    return write
