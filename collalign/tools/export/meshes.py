"""Aligned meshes as PLY, OBJ or STL, at full resolution and with normals outwards where the pose mirrors.

Colours, texture coordinates and materials are not written.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from collalign.tools.export.request import ExportRequest
from data_tools.io.files import file_stems
from data_tools.io.shapes import write_mesh


def writer(ending: str) -> Callable[[ExportRequest], tuple[Path, ...]]:
    """Return the writer of one mesh format: ``ply``, ``obj`` or ``stl``."""

    def write(request: ExportRequest) -> tuple[Path, ...]:
        """Write ``NAME.<ending>`` per shape, and ``NAME/PART.<ending>`` of its parts, one shape at a time."""
        transforms, written = request.transforms(), list[Path]()
        for at, stem in enumerate(file_stems(request.collection.names)):
            shape = request.source_shape(at).transformed(transforms[at])
            pieces = {stem: shape} | {f"{stem}/{part}": piece for part, piece in shape.split().items()}
            written += [write_mesh(request.path(f"{name}.{ending}"), piece) for name, piece in pieces.items()]
        return tuple(written)

    return write
