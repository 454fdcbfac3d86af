"""The dense stage: every posed shape registered to a mean surface, which is made of the registrations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.jobs.table import SharedTable
from collalign.engine.session import Session
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.products.deformation import VertexMaps
from collalign.registration.missing import mean_of_what_is_there, missing_vertices, with_cloud_rim
from collalign.registration.options import RegistrationOptions
from collalign.registration.pose import fitting_similarity
from collalign.registration.register import register
from collalign.registration.start import bent_by_map, unbent
from collalign.registration.surface import RegistrationSurface
from collalign.tools.correspond.map_starts import START_VERSION, MapStart, map_starts
from collalign.tools.correspond.result import DenseCorrespondence
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import CollectionError
from data_tools.io.shapes import read_shape
from data_tools.options import AS_STORED, CleaningOptions, SamplingOptions
from data_tools.poses import moved_by
from data_tools.surface.shape import Shape

#: Changes whenever the same surfaces and options would give another registration.
DENSE_VERSION = "dense-4"
#: Registrations of the collection: from its medoid, and then from the mean of those. A third changes the error of
#: landmarks carried over by less than .5 % (eight mouse skulls).
NUM_ROUNDS = 2
#: Larger meshes are decimated to so many triangles before they are registered.
MAX_FACES = 25_000
#: Records of this stage in the store, and what each holds.
KIND = "registrations"
_PARTS = ("vertices", "residual", "quality", "missing")


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedFile:
    """A file of a collection and where it stands.

    Attributes
    ----------
    name : str
    path : Path
    digest : str
        Of the file's content, which is to be the same when it is read.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    cleaning : CleaningOptions
    incomplete : bool
        Whether parts of the shape are missing, which are looked for then.
    """

    name: str
    path: Path
    digest: str
    transform: FloatArray
    cleaning: CleaningOptions
    incomplete: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class RegistrationTask:
    """What a worker needs to register a source, which all tasks share under this key, to one file.

    Where there is a map between both, the source starts from where the map takes it.
    """

    target: PosedFile
    source_key: str
    options: RegistrationOptions
    start: MapStart | None = None


def correspond(
    session: Session[RegistrationOptions],
    files: Sequence[PosedFile],
    reference: int,
    maps: VertexMaps | None = None,
) -> DenseCorrespondence:
    """Register a reference to every shape, then the mean of what came out, and return the last round.

    Parameters
    ----------
    session : Session
    files : sequence of PosedFile
        In the order of the collection.
    reference : int
        The shape that lends its triangles to the mean, see :func:`collalign.registration.mean.medoid`.
    maps : VertexMaps, optional
        Of a collection that deforms; registrations start from them.

    Raises
    ------
    CollectionError
        If fewer than two shapes can be registered.
    """
    source, file_vertices = posed_shape(files[reference])
    starts: Mapping[str, MapStart] = {}
    if maps is not None:
        starts = map_starts(maps, stored_shape(files[reference]), source, file_vertices)
    for _ in range(NUM_ROUNDS):
        found, failed = _register_all(session, files, source, starts)
        if len(found) < 2:
            raise CollectionError("\n".join(["fewer than two shapes could be registered", *failed.values()]))
        mean = _mean(list(found.values()), source, is_bent=bool(starts))
        source = Shape.from_arrays(mean, source.faces, name="mean")
    parts = {part: np.stack([record[part] for record in found.values()]) for part in _PARTS}
    missing = parts["missing"] != 0
    return DenseCorrespondence(
        names=tuple(found),
        faces=source.faces,
        mean=source.vertices,
        failed=tuple(failed.items()),
        vertices=read_only(np.where(missing[..., None], np.nan, parts["vertices"])),
        completed=read_only(parts["vertices"]),
        residual=read_only(np.where(missing, np.nan, parts["residual"])),
        quality=read_only(np.where(missing, 0.0, parts["quality"])),
    )


def _mean(found: Sequence[Record], source: Shape, *, is_bent: bool) -> FloatArray:
    """Return the mean of registered copies of a source, each where its shape is there; if bent, unbent."""
    centred = source.vertices - source.vertices.mean(axis=0)
    copies = [unposed(record) for record in found]
    return mean_of_what_is_there(
        unbent(source, copies) if is_bent else copies,
        [record["missing"] != 0 for record in found],
        source.vertices,
        float(np.sqrt((centred**2).sum(axis=1).mean())),
    )


def _register_all(
    session: Session[RegistrationOptions],
    files: Sequence[PosedFile],
    source: Shape,
    starts: Mapping[str, MapStart],
) -> tuple[dict[str, Record], dict[str, str]]:
    """Return the registrations of a source to every file, by name, and why others failed."""
    record = {"vertices": source.vertices, "faces": source.faces}
    source_key = fingerprint(DENSE_VERSION, record)
    every = {
        file.name: RegistrationTask(
            target=file, source_key=source_key, options=session.options, start=starts.get(file.name)
        )
        for file in files
    }
    keys = {name: _key(task) for name, task in every.items()}
    tasks = {keys[name]: (name, task) for name, task in every.items()}
    with SharedTable.create([(source_key, record)]) as shared:
        failures = session.compute(
            KIND, register_file, tasks, time_limit_s=session.run.shape_time_limit_s, shared=shared
        )
    failed = {name: failures[key].reason for name, key in keys.items() if key in failures}
    return {name: session.store.require(KIND, key) for name, key in keys.items() if name not in failed}, failed


def _key(task: RegistrationTask) -> str:
    file = task.target
    settings = {
        "options": task.options,
        "cleaning": file.cleaning,
        "suffix": file.path.suffix.lower(),
        "transform": file.transform,
        "incomplete": file.incomplete,
    }
    if task.start is not None:
        settings["start"] = fingerprint(START_VERSION, {"onto": task.start.onto, "back": task.start.back})
    return fingerprint(DENSE_VERSION, settings, file.digest, task.source_key)


def register_file(task: RegistrationTask, shared: Any) -> Record:
    """Register the shared source to one file; runs inside a worker."""
    record = shared[task.source_key]
    num_points = task.options.num_points
    shape, _ = posed_shape(task.target)
    target = RegistrationSurface.from_shape(shape, num_points)
    if task.target.incomplete:
        target = with_cloud_rim(target)
    source = Shape.from_arrays(record["vertices"], record["faces"], name="mean")
    bent = None
    if task.start is not None:
        bent = bent_by_map(shape, source, task.start.goals(stored_shape(task.target)))
    start = source if bent is None else Shape.from_arrays(bent, source.faces, name="mean")
    found = register(target, RegistrationSurface.from_shape(start, num_points), task.options)
    lacks = missing_vertices(target, found.vertices) if task.target.incomplete else np.zeros(len(found.vertices))
    return {
        "vertices": found.vertices,
        "residual": found.residual,
        "quality": found.quality,
        "pose": found.pose if bent is None else _pose(found.vertices, source.vertices),
        "missing": lacks.astype(np.int64),
    }


def _pose(vertices: FloatArray, source: FloatArray) -> FloatArray:
    """Return the similarity that lays a source onto its registered copy best, wherever it was registered from."""
    return fitting_similarity(vertices, source, np.ones(len(source)))


def unposed(record: Record) -> FloatArray:
    """Return the vertices of a registration without its similarity: what is averaged differs in shape alone."""
    return moved_by(np.linalg.inv(record["pose"]), record["vertices"])


def posed_shape(file: PosedFile) -> tuple[Shape, IntArray]:
    """Read a file, decimate it where it is large, and put it into the common frame.

    Returns
    -------
    shape : Shape
    file_vertices : ndarray of int, shape (v,)
        The file's vertex at, or nearest to, each of its vertices.
    """
    shape = read_shape(file.path, file.cleaning, name=file.name, digest=file.digest)
    working = WorkingSurface(shape, SamplingOptions(max_faces=MAX_FACES))
    kept = working.to_original
    in_file = kept if shape.source_indices is None else shape.source_indices[kept]
    return working.shape.transformed(file.transform), in_file


def stored_shape(file: PosedFile) -> Shape:
    """Read a file with the vertices that it has, and put it into the common frame."""
    return read_shape(file.path, AS_STORED, name=file.name, digest=file.digest).transformed(file.transform)
