"""Reads a result from its folder, without pickle, and checks every number of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from collalign.engine.records import Record, from_arrays, from_record, to_record
from collalign.output.collection import Collection
from collalign.output.evidence_file import (
    CORRESPONDENCES,
    CORRESPONDENCES_FILE,
    EVIDENCE_FILE,
    EVIDENCE_VERSION,
    RUN_FILE,
)
from collalign.products.run_record import RunRecord
from data_tools.arrays import as_faces, as_floats, as_indices
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.source import read_source
from data_tools.threads import one_blas_thread


@one_blas_thread()
def load(result: Collection | Path | str, *, sources: Path | str | None = None) -> Collection:
    """Read the result that ``collalign align`` or :meth:`Collection.save` wrote.

    Parameters
    ----------
    result : str, Path or Collection
        The folder. A collection is returned as it is, so that whatever takes a result takes it in either form.
    sources : str or Path, optional
        Folder that holds the original files now, where they have moved.

    Returns
    -------
    Collection

    Raises
    ------
    InputError
        If the folder holds no result, or one that is damaged or of another version, or ``sources`` none of its files.

    Examples
    --------
    >>> collection = collalign.load("aligned")
    >>> collection["B"].reflected
    False
    """
    found = result if isinstance(result, Collection) else _read(Path(result))
    return found if sources is None else found.with_sources(sources)


def _read(folder: Path) -> Collection:
    """Read the result of a folder."""
    path, beside = (folder / name for name in (EVIDENCE_FILE, CORRESPONDENCES_FILE))
    if not path.is_file():
        raise InputError(
            f"{path}: there is no such file. Give the folder that `collalign align FOLDER --out OUT` wrote (its OUT)"
        )
    with _readable(path):
        data = load_arrays(read_source(path).content, path.name)
        format = int(data.pop("version"))
    if format != EVIDENCE_VERSION:
        raise InputError(
            f"{path}: written in format {format}, but this version reads {EVIDENCE_VERSION}; "
            "run `collalign align` again"
        )
    with _readable(path):
        evidence = from_arrays(data)
        names = evidence["names"]
    with _readable(beside):
        correspondences = _correspondences(beside, names)
    with _readable(path):
        record = evidence | correspondences | {"run": to_record(RunRecord())}
        collection = from_record(Collection, record, "the collection")
        _check(collection)
    with _readable(folder / RUN_FILE):
        run = _run(folder / RUN_FILE)
    return replace(collection, folder=folder, run=run)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Name the file in any error of this block: damaged archives fail in every way there is."""
    try:
        yield
    except Exception as error:
        raise InputError(
            f"{path}: damaged or not written by collalign ({error}); run `collalign align` again"
        ) from error


def _run(path: Path) -> RunRecord:
    """Return how the run went; nothing is known of it where ``run.json`` is not there."""
    if not path.is_file():
        return RunRecord()
    record = to_record(RunRecord()) | json.loads(read_source(path).content)
    return from_record(RunRecord, record, path.name)


def _correspondences(path: Path, names: list[str]) -> Record:
    """Return what ``correspondences.npz`` holds of the collection, of the right shapes."""
    data = load_arrays(read_source(path).content, path.name)
    num, size = len(names), data["labels"].shape[-1]
    labels = as_indices(
        data["labels"], "labels", lower=-1, upper=len(data["consensus"]), shape=(num, size)
    )
    as_indices(data["vertex_indices"], "vertex_indices", upper=2**31, shape=(num, size))
    as_floats(data["positions"], "positions", shape=(num, size, 3))
    as_floats(data["consensus"], "consensus", shape=(None, 3))
    fields = {name: data[there] for name, there in CORRESPONDENCES.items()}
    return fields | {"maps": {"names": names, "labels": labels}}


def _check(collection: Collection) -> None:
    """Check what fields have to do with each other; each by itself was checked when it was read."""
    num, names = len(collection), collection.names
    of_shapes = (
        collection.files,
        collection.digests,
        collection.alternatives,
        collection.vertices,
        collection.faces,
    )
    counts = {
        len(values)
        for values in (*of_shapes, *collection.labels.values(), collection.places or names)
    }
    if counts != {num} or len(set(names)) != num:
        raise InputError(
            f"names: files, meshes, poses or labels are not of {num} shapes of different names"
        )
    if not np.linalg.det(collection.transforms[:, :3, :3]).all():
        raise InputError("transforms: singular")
    for vertices, faces in zip(collection.vertices, collection.faces, strict=True):
        as_faces(faces, "faces", num_vertices=len(vertices))
    for vertices, places in zip(collection.vertices, collection.places, strict=False):
        if len(places) not in (0, len(vertices)):
            raise InputError(f"places: colours of {len(places)} vertices, not of {len(vertices)}")
    for pair in collection.pairs:
        as_indices([pair.target, pair.source], "pairs", upper=num)
        as_indices(pair.choice, "choice", lower=-1, upper=len(pair.energies))
        as_indices(pair.map_target_source, "maps", lower=-1, upper=collection.samples.shape[1])
        if pair.target == pair.source or pair.rotations.shape[1:] != (3, 3):
            raise InputError("pairs: a shape with itself, or poses that are not of space")
    for one in collection.incomplete:
        as_indices([one.shape, *one.partners], "incomplete shapes", upper=num)
    as_indices([one.shape for one in collection.extra], "shapes with extra material", upper=num)
