"""Aligned meshes as PLY, OBJ or STL, at full resolution."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from collalign.exports.request import ExportRequest, file_stems
from data_tools.arrays import FloatArray
from data_tools.mesh_io import write_mesh
from data_tools.shape import Shape


def writer(ending: str) -> Callable[[ExportRequest], tuple[Path, ...]]:
    """Return the writer of one mesh format: ``ply``, ``obj`` or ``stl``."""

    def write(request: ExportRequest) -> tuple[Path, ...]:
        """Write ``NAME.<ending>`` per shape, one shape in memory at a time."""
        transforms = request.transforms()
        stems = file_stems(request.view.names)
        return tuple(
            write_mesh(request.folder / f"{stem}.{ending}", transformed(request.source_shape(at), transforms[at]))
            for at, stem in enumerate(stems)
        )

    return write


def transformed(shape: Shape, transform: FloatArray) -> Shape:
    """Apply a 4 x 4 transform; where it mirrors, triangles are turned round so that normals still point outwards."""
    faces = shape.faces[:, ::-1] if np.linalg.det(transform[:3, :3]) < 0 else shape.faces
    vertices = shape.vertices @ transform[:3, :3].T + transform[:3, 3]
    return Shape.from_arrays(vertices, faces, name=shape.name, file=shape.file)
