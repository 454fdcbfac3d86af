"""The shape stage: files in, samples and their embedding out, one job per file, each result kept in the store."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from collalign.engine.store.keys import fingerprint, hash_file
from collalign.engine.store.records import Record
from collalign.options import AlignOptions, AlignSession
from collalign.products.shapes import Excluded, Shapes
from collalign.stages.stored_types import samples_from_record, samples_to_record
from data_tools.arrays import read_only
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.errors import CollectionError, InputError
from data_tools.io.shapes import FolderListing, read_shape
from data_tools.options import CleaningOptions, EmbeddingOptions, SamplingOptions

#: Changes whenever the same file and options would give other samples.
SHAPE_VERSION = "shape-5"


@dataclass(frozen=True, kw_only=True)
class ShapeTask:
    """What a worker needs to prepare one shape."""

    path: Path
    name: str
    cleaning: CleaningOptions
    sampling: SamplingOptions
    embedding: EmbeddingOptions


def prepare_shape(task: ShapeTask) -> Record:
    """Read, clean, sample and embed one shape; runs inside a worker.

    Returns
    -------
    dict
        The fields of :class:`data_tools.embedding.embedding.Samples` as a record, without the name.
    """
    return samples_to_record(sample_file(task))


def sample_file(task: ShapeTask) -> Samples:
    """Read, clean, sample and embed one shape; ``vertex_indices`` count the vertices of the file."""
    shape = read_shape(task.path, task.cleaning, name=task.name)
    samples = sample_shape(shape, task.sampling, task.embedding)
    if shape.source_indices is None:
        return samples
    return replace(samples, vertex_indices=read_only(shape.source_indices[samples.vertex_indices]))


def prepare_shapes(session: AlignSession, listing: FolderListing) -> Shapes:
    """Read, clean, sample and embed every file whose result the store does not hold yet.

    Parameters
    ----------
    session : Session
    listing : FolderListing

    Raises
    ------
    InputError
        With ``options.strict``, for the first file that cannot be prepared.
    CollectionError
        If fewer than two shapes remain.
    StoreError
        If a record is damaged.
    """
    options = session.options
    keyed, excluded = shape_keys(listing, options)
    failures = session.compute(
        "shapes",
        prepare_shape,
        {key: (file.name, shape_task(file, name, options)) for name, (key, file) in keyed.items()},
        time_limit_s=session.run.shape_time_limit_s,
        strict=options.strict,
    )
    good = {name: key for name, (key, _) in keyed.items() if key not in failures}
    excluded += [_excluded(file, failures[key].reason) for key, file in keyed.values() if key in failures]
    if len(good) < 2:
        reasons = "".join(f"\n  {item.file}: {item.reason}" for item in excluded)
        raise CollectionError(f"{len(good)} readable shapes, at least two are needed to align a collection{reasons}")
    return Shapes(
        names=tuple(good),
        files=tuple(keyed[name][1].absolute() for name in good),
        keys=tuple(good.values()),
        samples=tuple(samples_from_record(session.store.require("shapes", key), name) for name, key in good.items()),
        excluded=tuple(excluded),
    )


def _excluded(file: Path, reason: str) -> Excluded:
    """Return the file and why it is left out; the reason does not say again where it lies."""
    for path in (file.absolute(), file):
        reason = reason.removeprefix(f"{path}: ")
    return Excluded(file=file.name, reason=reason)


def shape_task(file: Path, name: str, options: AlignOptions) -> ShapeTask:
    """Return what has to be done for one file."""
    return ShapeTask(
        path=file.absolute(),
        name=name,
        cleaning=options.cleaning,
        sampling=options.sampling,
        embedding=options.embedding,
    )


def shape_keys(listing: FolderListing, options: AlignOptions) -> tuple[dict[str, tuple[str, Path]], list[Excluded]]:
    """Return (key in the store, file) of every name, and the files that cannot even be opened."""
    keyed, excluded = {}, []
    settings = {"cleaning": options.cleaning, "sampling": options.sampling, "embedding": options.embedding}
    for file, name in zip(listing.files, listing.names, strict=True):
        try:
            content = hash_file(file)
        except InputError as error:
            if options.strict:
                raise
            excluded.append(_excluded(file, str(error)))
            continue
        # The reader depends on the suffix as well as on the content.
        keyed[name] = (fingerprint(SHAPE_VERSION, settings | {"suffix": file.suffix.lower()}, content), file)
    return keyed, excluded
