"""The shape stage: files in, samples and their embedding out, one job per file, each result kept in the store."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.options import AlignOptions, AlignSession, TwoShapeOptions
from collalign.products.shapes import Excluded, Shapes
from collalign.stages.stored_types import samples_from_record, samples_to_record
from data_tools.arrays import read_only
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.errors import CollectionError, InputError
from data_tools.io.shapes import FolderListing, read_shape
from data_tools.io.source import hash_source
from data_tools.options import CleaningOptions, EmbeddingOptions, SamplingOptions

#: Changes whenever the same file and options would give other samples.
SHAPE_VERSION = "shape-6"


@dataclass(frozen=True, kw_only=True)
class ShapeTask:
    """What a worker needs to prepare one shape.

    Attributes
    ----------
    digest : str or None
        Of the content that the key of the result stands for: a file that has changed since is refused.
    """

    path: Path
    name: str
    digest: str | None
    cleaning: CleaningOptions
    sampling: SamplingOptions
    embedding: EmbeddingOptions


@dataclass(frozen=True, kw_only=True)
class KeyedFile:
    """A file, the digest of its content and the key of its record in the store."""

    file: Path
    digest: str
    key: str


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
    shape = read_shape(task.path, task.cleaning, name=task.name, digest=task.digest)
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
    tasks = {
        item.key: (item.file.name, shape_task(item.file, name, options, digest=item.digest))
        for name, item in keyed.items()
    }
    failures = session.compute(
        "shapes",
        prepare_shape,
        tasks,
        time_limit_s=session.run.shape_time_limit_s,
        strict=options.strict,
    )
    good = {name: item for name, item in keyed.items() if item.key not in failures}
    excluded += [_excluded(item.file, failures[item.key].reason) for item in keyed.values() if item.key in failures]
    if len(good) < 2:
        reasons = "".join(f"\n  {item.file}: {item.reason}" for item in excluded)
        raise CollectionError(f"{len(good)} readable shapes, at least two are needed to align a collection{reasons}")
    return Shapes(
        names=tuple(good),
        files=tuple(item.file.absolute() for item in good.values()),
        digests=tuple(item.digest for item in good.values()),
        keys=tuple(item.key for item in good.values()),
        samples=tuple(
            samples_from_record(session.store.require("shapes", item.key), name) for name, item in good.items()
        ),
        excluded=tuple(excluded),
    )


def _excluded(file: Path, reason: str) -> Excluded:
    """Return the file and why it is left out; the reason does not say again where it lies."""
    for path in (file.absolute(), file):
        reason = reason.removeprefix(f"{path}: ")
    return Excluded(file=file.name, reason=reason)


def shape_task(
    file: Path, name: str, options: AlignOptions | TwoShapeOptions, *, digest: str | None = None
) -> ShapeTask:
    """Return what has to be done for one file."""
    return ShapeTask(
        path=file.absolute(),
        name=name,
        digest=digest,
        cleaning=options.cleaning,
        sampling=options.sampling,
        embedding=options.embedding,
    )


def shape_keys(listing: FolderListing, options: AlignOptions) -> tuple[dict[str, KeyedFile], list[Excluded]]:
    """Return the file and its key of every name, and the files that cannot even be opened."""
    keyed, excluded = {}, []
    settings = {"cleaning": options.cleaning, "sampling": options.sampling, "embedding": options.embedding}
    for file, name in zip(listing.files, listing.names, strict=True):
        try:
            digest = hash_source(file)
        except InputError as error:
            if options.strict:
                raise
            excluded.append(_excluded(file, str(error)))
            continue
        # The reader depends on the suffix as well as on the content.
        key = fingerprint(SHAPE_VERSION, settings | {"suffix": file.suffix.lower()}, digest)
        keyed[name] = KeyedFile(file=file, digest=digest, key=key)
    return keyed, excluded
