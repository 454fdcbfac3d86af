"""The dense stage: every posed shape registered to a mean surface, which is made of the registrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.jobs.table import SharedTable
from collalign.engine.session import Session
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.products.dense import DenseCorrespondence
from collalign.registration.missing import mean_of_what_is_there, missing_vertices, with_cloud_rim
from collalign.registration.options import RegistrationOptions
from collalign.registration.pose import moved_by
from collalign.registration.register import register
from collalign.registration.surface import RegistrationSurface
from data_tools.arrays import FloatArray, read_only
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import CollectionError
from data_tools.io.shapes import read_shape
from data_tools.options import CleaningOptions, SamplingOptions
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
    """What a worker needs to register a source, which all tasks share under this key, to one file."""

    target: PosedFile
    source_key: str
    options: RegistrationOptions


def correspond(
    session: Session[RegistrationOptions], files: Sequence[PosedFile], reference: int
) -> DenseCorrespondence:
    """Register a reference to every shape, then the mean of what came out, and return the last round.

    Parameters
    ----------
    session : Session
    files : sequence of PosedFile
        In the order of the collection.
    reference : int
        The shape that lends its triangles to the mean, see :func:`collalign.registration.mean.medoid`.

    Raises
    ------
    CollectionError
        If fewer than two shapes can be registered.
    """
    source = posed_shape(files[reference])
    for _ in range(NUM_ROUNDS):
        found, failed = _register_all(session, files, source)
        if len(found) < 2:
            raise CollectionError("\n".join(["fewer than two shapes could be registered", *failed.values()]))
        source = Shape.from_arrays(_mean(list(found.values()), source), source.faces, name="mean")
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


def _mean(found: Sequence[Record], source: Shape) -> FloatArray:
    """Return the mean of registered copies of a source, each where its shape is there."""
    centred = source.vertices - source.vertices.mean(axis=0)
    return mean_of_what_is_there(
        [unposed(record) for record in found],
        [record["missing"] != 0 for record in found],
        source.vertices,
        float(np.sqrt((centred**2).sum(axis=1).mean())),
    )


def _register_all(
    session: Session[RegistrationOptions], files: Sequence[PosedFile], source: Shape
) -> tuple[dict[str, Record], dict[str, str]]:
    """Return the registrations of a source to every file, by name, and why others failed."""
    record = {"vertices": source.vertices, "faces": source.faces}
    source_key = fingerprint(DENSE_VERSION, record)
    keys = {file.name: _key(file, source_key, session.options) for file in files}
    tasks = {
        keys[file.name]: (file.name, RegistrationTask(target=file, source_key=source_key, options=session.options))
        for file in files
    }
    with SharedTable.create([(source_key, record)]) as shared:
        failures = session.compute(
            KIND, register_file, tasks, time_limit_s=session.run.shape_time_limit_s, shared=shared
        )
    failed = {name: failures[key].reason for name, key in keys.items() if key in failures}
    return {name: session.store.require(KIND, key) for name, key in keys.items() if name not in failed}, failed


def _key(file: PosedFile, source_key: str, options: RegistrationOptions) -> str:
    settings = {
        "options": options,
        "cleaning": file.cleaning,
        "suffix": file.path.suffix.lower(),
        "transform": file.transform,
        "incomplete": file.incomplete,
    }
    return fingerprint(DENSE_VERSION, settings, file.digest, source_key)


def register_file(task: RegistrationTask, shared: Any) -> Record:
    """Register the shared source to one file; runs inside a worker."""
    record = shared[task.source_key]
    num_points = task.options.num_points
    target = RegistrationSurface.from_shape(posed_shape(task.target), num_points)
    if task.target.incomplete:
        target = with_cloud_rim(target)
    source = Shape.from_arrays(record["vertices"], record["faces"], name="mean")
    found = register(target, RegistrationSurface.from_shape(source, num_points), task.options)
    lacks = missing_vertices(target, found.vertices) if task.target.incomplete else np.zeros(len(found.vertices))
    return {
        "vertices": found.vertices,
        "residual": found.residual,
        "quality": found.quality,
        "pose": found.pose,
        "missing": lacks.astype(np.int64),
    }


def unposed(record: Record) -> FloatArray:
    """Return the vertices of a registration without its similarity: what is averaged differs in shape alone."""
    return moved_by(np.linalg.inv(record["pose"]), record["vertices"])


def posed_shape(file: PosedFile) -> Shape:
    """Read a file, decimate it where it is large, and put it into the common frame."""
    shape = read_shape(file.path, file.cleaning, name=file.name, digest=file.digest)
    return WorkingSurface(shape, SamplingOptions(max_faces=MAX_FACES)).shape.transformed(file.transform)
