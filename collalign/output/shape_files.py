"""What is made of each shape's file: its aligned mesh, and its mesh for the report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from collalign.engine.job import run_task
from collalign.engine.run_jobs import run_jobs
from collalign.output.collection_data import CollectionData
from collalign.output.vertex_maps import PlaceColours, at_vertices
from collalign.output.views import display_mesh, faces_per_shape
from collalign.products.shapes import PosedFile
from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh

Made = TypeVar("Made")
#: The display mesh of one shape, for the report and the contact sheet: its vertices (v, 3) in the file's coordinates,
#: its faces (f, 3), and the vertices' colours by place and confidence (v, 4), (0, 4) if none.
DisplayMesh: TypeAlias = tuple[FloatArray, IntArray, NDArray[np.uint8]]


def write_shape(
    file: PosedFile, *, mesh: Path, max_faces: int, colours: FloatArray | None
) -> DisplayMesh:
    """Read a shape, write its aligned copy and decimate it; runs inside a worker.

    Parameters
    ----------
    file : PosedFile
    mesh : Path
        Where to write the aligned mesh; its parts go to a folder of its name.
    max_faces : int
        Of the mesh for the report.
    colours : ndarray, shape (f, 4), or None
        Of its file's vertices; see :meth:`collalign.output.vertex_maps.PlaceColours.of_file`.
    """
    shape = file.read()
    aligned = shape.transformed(file.transform)
    write_mesh(mesh, aligned)
    for part, piece in aligned.split().items():
        write_mesh(mesh.with_suffix("") / f"{part}.ply", piece)
    vertices, faces = display_mesh(shape.vertices, shape.faces, max_faces=max_faces)
    places = np.empty((0, 4), dtype=np.uint8)
    if colours is not None:
        colours = at_vertices(colours, shape)[
            scipy.spatial.cKDTree(shape.vertices).query(vertices)[1]
        ]
        places = np.round(255.0 * colours).astype(np.uint8)
    return vertices, faces, places


def write_shapes(
    collection: CollectionData,
    meshes: Sequence[Path],
    colours: PlaceColours | None,
    *,
    num_jobs: int = 1,
    advance: Callable[[], None] | None = None,
) -> list[DisplayMesh]:
    """Write the aligned meshes, and return what else is made of the shapes; each file is read once.

    Parameters
    ----------
    collection : CollectionData
    meshes : sequence of Path
        Where to write the aligned mesh of each shape.
    colours : PlaceColours or None
        By place.
    num_jobs : int
        Processes of this machine that share the work; 1 is this one alone.
    advance : callable, optional
        Called after each shape.

    Raises
    ------
    InputError
        If a file has vanished or changed meanwhile, or a mesh cannot be written.
    """
    num = len(collection.names)
    tasks = (
        (
            str(i),
            {
                "file": collection.posed_file(i),
                "mesh": meshes[i],
                "max_faces": faces_per_shape(num),
                "colours": None if colours is None else colours.of_file(name),
            },
        )
        for i, name in enumerate(collection.names)
    )
    parts = share_out(write_shape, tasks, num_jobs=num_jobs, advance=advance)
    return [parts[str(i)] for i in range(num)]


def share_out(
    function: Callable[..., Made],
    tasks: Iterable[tuple[str, Mapping[str, Any]]],
    *,
    num_jobs: int,
    advance: Callable[[], None] | None = None,
) -> dict[str, Made]:
    """Return what a function of a module makes of each task's arguments, by key, on several processes.

    Raises
    ------
    InputError
        At the first task that fails.
    """
    made: dict[str, Made] = {}
    jobs = run_jobs(partial(run_task, function, False), tasks, num_jobs=num_jobs)
    for job in jobs:
        if job.failure is not None:
            jobs.close()
            raise InputError(job.failure)
        made[job.key] = job.value
        if advance is not None:
            advance()
    return made
