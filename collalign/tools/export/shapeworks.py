"""A ShapeWorks project: original meshes, poses, and the consistent samples as particles."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from collalign.tools.export.request import ExportRequest, complete_labels, words
from data_tools.arrays import FloatArray
from data_tools.io.files import file_stems
from data_tools.io.shapes import write_mesh


def write(request: ExportRequest) -> tuple[Path, ...]:
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
