"""Formats of meshes and poses: PLY, OBJ and STL, transforms of ITK, projects of ShapeWorks."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from collalign.tools.export.request import ExportRequest, complete_labels, words
from data_tools.arrays import FloatArray
from data_tools.io.coordinate_systems import LPS_RAS
from data_tools.io.files import file_stems
from data_tools.io.shapes import write_mesh


def mesh_writer(ending: str) -> Callable[[ExportRequest], tuple[Path, ...]]:
    """Return the writer of one mesh format: ``ply``, ``obj`` or ``stl``.

    Meshes are written at full resolution, with normals outwards where the pose mirrors, and without colours, texture
    coordinates and materials.
    """

    def write(request: ExportRequest) -> tuple[Path, ...]:
        """Write ``NAME.<ending>`` per shape, and ``NAME/PART.<ending>`` of its parts, one shape at a time."""
        transforms, written = request.transforms(), list[Path]()
        for at, stem in enumerate(file_stems(request.collection.names)):
            shape = request.source_shape(at).transformed(transforms[at])
            pieces = {stem: shape} | {f"{stem}/{part}": piece for part, piece in shape.split().items()}
            written += [write_mesh(request.path(f"{name}.{ending}"), piece) for name, piece in pieces.items()]
        return tuple(written)

    return write


def write_transforms(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``NAME.tfm`` per shape: the *inverse* of its pose, from the common frame to file coordinates.

    Read by 3D Slicer, SimpleITK, ANTs and ITK-SNAP.
    ITK's transforms take points of the fixed (common) space to the moving one, and 3D Slicer inverts them on loading:
    applied there to the original mesh, the file moves it onto the aligned one. In SimpleITK, ``GetInverse()`` is the
    pose. Coordinates are the mesh's own, read as LPS, as Slicer reads meshes, unless its file declares RAS.
    """
    paths = []
    files = zip(file_stems(request.collection.names), request.transforms(), request.file_systems(), strict=True)
    for stem, transform, system in files:
        inverse = np.linalg.inv(transform)
        if system == "RAS":
            inverse[:3] *= LPS_RAS[:, None]
        numbers = [*inverse[:3, :3].ravel(), *inverse[:3, 3]]
        lines = [
            "#Insight Transform File V1.0",
            "#Transform 0",
            "Transform: AffineTransform_double_3_3",
            f"Parameters: {words(numbers)}",
            "FixedParameters: 0 0 0",
        ]
        paths.append(request.write(f"{stem}.tfm", "\n".join(lines) + "\n"))
    return tuple(paths)


def write_shapeworks(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``project.swproj`` with ``meshes/`` and ``particles/`` beside it; all paths in it are relative.

    Local particles are samples in file coordinates, world particles the same in the common frame, and the alignment
    is the pose (16 numbers, row-major). Only labels that every shape has become particles; a particle file ends in a
    line end, without which its last point would be lost. ShapeWorks reads every section as maps from text to
    text (``JsonProjectReader``), so that numbers are written as text too.
    """
    collection = request.collection
    common = complete_labels(collection)
    local, world = collection.landmarks[:, common], collection.aligned_landmarks[:, common]
    paths, entries = [], []
    for at, stem in enumerate(file_stems(collection.names)):
        files = {
            "mesh": f"meshes/{stem}.ply",
            "local": f"particles/{stem}_local.particles",
            "world": f"particles/{stem}_world.particles",
        }
        paths.append(write_mesh(request.path(files["mesh"]), request.source_shape(at)))
        paths.append(request.write(files["local"], _particles(local[at])))
        paths.append(request.write(files["world"], _particles(world[at])))
        entries.append(
            {
                "name": collection.names[at],
                "shape_1": files["mesh"],
                "groomed_1": files["mesh"],
                "alignment_1": words(collection.transforms[at].ravel()),
                "local_particles_1": files["local"],
                "world_particles_1": files["world"],
                **{f"group_{column}": values[at] for column, values in collection.labels.items()},
            }
        )
    project = {"data": entries, "optimize": {"number_of_particles": str(int(np.sum(common)))}}
    return request.write("project.swproj", json.dumps(project, indent=1) + "\n"), *paths


def _particles(points: FloatArray) -> str:
    return "".join(words(point) + "\n" for point in points)
