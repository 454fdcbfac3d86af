"""The shape stage: files in, samples and their embedding out, one job per file, each result kept in the store."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import numpy as np

from collalign.engine.job import Job, Results, T, Wanted
from collalign.engine.store_file import NUM_FILES
from collalign.options import AUTO, AlignOptions, AlignSession
from collalign.products.shapes import Excluded, Shapes
from data_tools.arrays import FloatArray, Holds, read_only
from data_tools.embedding.chirality import NO_CHIRALITY, SurfaceChirality, surface_chirality
from data_tools.embedding.embedding import Samples, sample_file
from data_tools.embedding.sampling import OwnPoints
from data_tools.errors import CollectionError, InputError, printable
from data_tools.io.formats.raw_shape import content_not_kept
from data_tools.io.listing import TABLES, FolderListing, hash_shape, relative_path
from data_tools.io.shapes import coarse_coordinates, read_shape
from data_tools.io.source import Origin, Source, location
from data_tools.notes import Note, listed
from data_tools.options import NUM_QUANTILES, CleaningOptions, Components
from data_tools.surface.cleaning import (
    PLAIN_LEFT_OUT,
    SHARED_TAKEN,
    hold_pieces,
    piece_signatures,
    shared_object,
)
from data_tools.surface.extra import ExtraSurface
from data_tools.surface.hidden import WALLS_LEFT_OUT, differ_in_walls
from data_tools.surface.outliers import apart_ratios, odd_ratios

#: Shapes of a larger collection that the pilot looks at: a side with a twentieth of the shapes is among so many.
MOST_FOR_SIDES = 150

#: Reads, cleans, samples and embeds a shape. The version changes whenever the same file would give other samples.
SAMPLING = Job(kind="shapes", version="shape-24", run=sample_file, reader=Samples)


def prepare_shapes(
    session: AlignSession,
    listing: FolderListing,
    own: Mapping[str, OwnPoints] | None = None,
    extra: Mapping[str, ExtraSurface] = MappingProxyType({}),
    pieces: Mapping[str, Components] = MappingProxyType({}),
) -> Shapes:
    """Read, clean, sample and embed every file whose result the store does not hold yet.

    Parameters
    ----------
    session : Session
    listing : FolderListing
    own : mapping of str to OwnPoints, optional
        Samples and invariants that are given, by name.
    extra : mapping of str to ExtraSurface, optional
        Material of some shapes that is left out, by name.
    pieces : mapping of str to str, optional
        Components of some shapes that are read in place of those that the options say, by name.

    Raises
    ------
    InputError
        With ``options.strict``, for the first file that cannot be prepared.
    CollectionError
        If fewer than two shapes remain.
    StoreError
        If a record is damaged.
    """
    wanted = session.options.sampling.num_points
    own = own or {}
    shapes = _prepare(session, listing, session.options, own, extra, pieces)
    counts = {one.name: one.num_places for one in shapes.samples}
    num = common_num_points([*counts.values()], wanted)
    if num < wanted:
        fewer = replace(session.options.sampling, num_points=num)
        shapes = _prepare(
            session, listing, replace(session.options, sampling=fewer), own, extra, pieces
        )
    shapes = replace(shapes, notes=few_points(counts, num, wanted))
    odd = odd_sizes(dict(zip(shapes.names, [item.scale for item in shapes.samples], strict=True)))
    said = {name: item.notes for name, item in zip(shapes.names, shapes.samples, strict=True)}
    shapes = replace(
        shapes,
        notes=(
            *shapes.notes,
            *odd,
            *coarse_coordinates(said),
            *content_not_kept(said),
            *left_out_of(said),
        ),
    )
    if len(shapes.names) < 2:
        reasons = [f"{item.file}: {item.reason}" for item in shapes.excluded]
        tables = [name for name in listing.skipped_names if Path(name).suffix.lower() in TABLES]
        if tables:
            reasons.append(
                f"{listed(tables)}: tables beside meshes; to align them too, use --include"
            )
        found = (
            f"{len(shapes.names)} readable shapes, at least two are needed to align a collection"
        )
        raise CollectionError("; ".join([found, *reasons]))
    return shapes


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """What the pieces of a shape that may be the object look like.

    Attributes
    ----------
    signatures : ndarray, shape (p, 16)
        As :func:`data_tools.surface.cleaning.piece_signatures` returns them.
    """

    signatures: Annotated[FloatArray, Holds(shape="p 16")]


def pieces_of_file(
    path: Origin, name: str, digest: str | None, cleaning: CleaningOptions
) -> Pieces:
    """Return what the pieces of a file look like; runs inside a worker."""
    every = replace(cleaning, components="all", inner="keep")
    shape = read_shape(path, every, name=name, digest=digest)
    found = piece_signatures(shape) if shape.is_mesh else np.empty((0, NUM_QUANTILES))
    return Pieces(signatures=read_only(found))


#: Looks at the pieces of a file. The version changes whenever the same file would give another result.
LOOKING = Job(kind="surfaces", version="pieces-1", run=pieces_of_file, reader=Pieces)


def decided_reading(session: AlignSession, shapes: Shapes) -> AlignSession:
    """Return the session that reads shapes as they are alike: the same piece of each, with walls inside or without.

    Parameters
    ----------
    session : Session
    shapes : Shapes
        As :func:`prepare_shapes` read them with this session.
    """

    def signatures() -> list[FloatArray]:
        wanted = {i: wanted_file(LOOKING, session, shapes, i) for i in range(len(shapes.names))}
        limit_s = session.run.shape_time_limit_s
        found = session.compute(LOOKING, wanted, time_limit_s=limit_s).values()
        return [one.signatures for one in found]

    before = session.options.cleaning
    cleaning = decided_cleaning(
        before,
        [item.notes for item in shapes.samples],
        [len(item.dense_normals) > 0 for item in shapes.samples],
        signatures,
    )
    if cleaning == before:
        return session
    return replace(session, options=replace(session.options, cleaning=cleaning))


def decided_cleaning(
    cleaning: CleaningOptions,
    notes: Sequence[Sequence[Note]],
    are_sided: Sequence[bool],
    signatures: Callable[[], Sequence[FloatArray]],
) -> CleaningOptions:
    """Return how shapes are to be read that were read once.

    Parameters
    ----------
    cleaning : CleaningOptions
        How they were read.
    notes : sequence of sequence of Note
        What was said of each shape.
    are_sided : sequence of bool
        Whether the triangles of each agree on a side.
    signatures : callable
        Returns what the pieces of each shape look like; asked where some shapes hold several.
    """
    if cleaning.inner == AUTO and differ_in_walls(notes, are_sided):
        cleaning = replace(cleaning, inner="drop")
    several = [hold_pieces(own) for own in notes]
    if cleaning.components != "all" and not cleaning.like and any(several) and not all(several):
        found = [of_one for of_one in signatures() if len(of_one)]
        cleaning = replace(cleaning, like=shared_object(found))
    return cleaning


def left_out_of(shapes: Mapping[str, Sequence[Note]]) -> tuple[Note, ...]:
    """Return the notes that name the shapes whose walls inside, or larger pieces, were left out.

    Parameters
    ----------
    shapes : mapping of str to sequence of Note
        The notes of each shape by its name.
    """

    def shares_in(code: str) -> dict[str, float]:
        return {
            name: float(str(one.values["share"]))
            for name, own in shapes.items()
            for one in own
            if one.code == code
        }

    walls, plain = shares_in(WALLS_LEFT_OUT), shares_in(PLAIN_LEFT_OUT)
    shared = shares_in(SHARED_TAKEN)
    of_walls = Note("walls-left-out", tuple(walls), {"shares": tuple(walls.values())})
    of_plain = Note("plain-left-out", tuple(plain), {"shares": tuple(plain.values())})
    of_shared = Note("shared-pieces", tuple(shared), {"shares": tuple(shared.values())})
    return tuple(note for note in (of_walls, of_plain, of_shared) if note.shapes)


def common_num_points(counts: Sequence[int], wanted: int) -> int:
    """Return at how many points all shapes are matched: as many as asked for, or as the shape of most points has.

    A shape of fewer points lowers nobody: some of its points stand for several of the others.

    Parameters
    ----------
    counts : sequence of int
        Points of each shape.
    wanted : int
    """
    return min(wanted, max(counts, default=wanted))


def few_points(counts: Mapping[str, int], num: int, wanted: int) -> tuple[Note, ...]:
    """Return notes where shapes are matched at fewer points than asked for, or some have fewer than the others.

    Parameters
    ----------
    counts : mapping of str to int
        Points of each shape.
    num, wanted : int
        Points that shapes are matched at, and that were asked for.
    """
    few = {name: count for name, count in counts.items() if count < num}
    lowered = Note("fewer-points", values={"num": num, "asked": wanted})
    poor = Note("few-points", tuple(few), {"num": num, "counts": tuple(few.values())})
    return (*((lowered,) if num < wanted else ()), *((poor,) if few else ()))


def odd_sizes(sizes: Mapping[str, float]) -> tuple[Note, ...]:
    """Return notes that name shapes of quite another size than the others.

    Parameters
    ----------
    sizes : mapping of str to float
        A length of each shape in the unit of its file.
    """
    ratios, found = odd_ratios(sizes), []
    for code, sign in (("much-smaller", -1), ("much-larger", 1)):
        odd = {name: float(ratio**sign) for name, ratio in ratios.items() if ratio**sign > 1}
        if odd:
            found.append(Note(code, tuple(odd), {"times": tuple(odd.values())}))
    if apart := apart_ratios(sizes):
        found.append(Note("size-apart", tuple(apart), {"times": tuple(apart.values())}))
    return tuple(found)


def _prepare(
    session: AlignSession,
    listing: FolderListing,
    options: AlignOptions,
    own: Mapping[str, OwnPoints],
    extra: Mapping[str, ExtraSurface],
    pieces: Mapping[str, Components],
) -> Shapes:
    """Read, clean, sample and embed every file, each at as many points as asked for."""
    wanted, excluded = wanted_shapes(listing, options, own, extra, pieces)
    session.store.set_note(NUM_FILES, str(len(wanted)))
    found = session.compute(
        SAMPLING, wanted, time_limit_s=session.run.shape_time_limit_s, strict=options.strict
    )
    files = {name: one.arguments["file"] for name, one in wanted.items()}
    excluded += [
        excluded_file(files[name], name, reason) for name, reason in found.failures.items()
    ]
    read = [replace(samples, name=name) for name, samples in found.items()]
    return Shapes(
        names=tuple(found),
        files=tuple(files[name] for name in found),
        digests=tuple(wanted[name].arguments["digest"] for name in found),
        keys=tuple(wanted[name].key for name in found),
        samples=tuple(replace(samples, chirality=None) for samples in read),
        cleaning=tuple(wanted[name].arguments["cleaning"] for name in found),
        chirality=tuple(samples.chirality for samples in read),
        excluded=tuple(excluded),
    )


def excluded_file(file: Origin, name: str, reason: str) -> Excluded:
    """Return a file, called with as many folders as its shape is, and why it is left out, without its place again."""
    for path in (file.path,) if isinstance(file, Source) else (file.absolute(), file):
        reason = reason.removeprefix(printable(f"{path}: "))
    shown = (
        file.name
        if isinstance(file, Source)
        else "/".join(file.absolute().parts[-1 - name.count("/") :])
    )
    return Excluded(file=printable(shown), reason=reason)


def wanted_shapes(
    listing: FolderListing,
    options: AlignOptions,
    own: Mapping[str, OwnPoints],
    extra: Mapping[str, ExtraSurface] = MappingProxyType({}),
    pieces: Mapping[str, Components] = MappingProxyType({}),
) -> tuple[dict[str, Wanted], list[Excluded]]:
    """Return what is wanted of the file of every name, and the files that cannot even be opened."""
    wanted, excluded = {}, []
    # Not part of the key: samples are the same, and what lacks the chirality is measured later.
    with_chirality = options.group == "auto" and len(listing.files) <= MOST_FOR_SIDES
    usual = options.cleaning
    if usual.components == AUTO:
        usual = replace(usual, components="largest")
    for file, name in zip(listing.files, listing.names, strict=True):
        try:
            digest = hash_shape(file)
        except InputError as error:
            if options.strict:
                raise
            excluded.append(excluded_file(file, name, str(error)))
            continue
        # The reader depends on the suffix as well as on the content.
        given = [points[name].digest for points in (own, extra) if name in points]
        cleaning = replace(usual, components=pieces.get(name, usual.components))
        settings = {
            "cleaning": cleaning,
            "sampling": options.sampling,
            "embedding": options.embedding,
        }
        keyed = vars(cleaning).copy()
        del keyed["columns"]  # which change nothing of files that are no tables
        suffix, columns = file.suffix.lower(), cleaning.columns
        if suffix in TABLES or (suffix == ".*" and columns):
            given += ["columns", columns]
        wanted[name] = Wanted(
            key=SAMPLING.key(settings | {"cleaning": keyed, "suffix": suffix}, digest, *given),
            label=relative_path(name, location(file)) or file.name,
            arguments=settings
            | {"file": file.absolute(), "name": name, "digest": digest}
            | {"own": own.get(name), "extra": extra.get(name), "with_chirality": with_chirality},
        )
    return wanted, excluded


def chirality_of_file(
    path: Origin, name: str, digest: str, cleaning: CleaningOptions
) -> SurfaceChirality:
    """Measure one surface, unless its file has changed since its digest was taken; runs inside a worker."""
    return surface_chirality(read_shape(path, cleaning, name=name, digest=digest))


#: Measures a surface. The version changes whenever the same file would give another result.
MEASURING = Job(
    kind="surfaces", version="chirality-2", run=chirality_of_file, reader=SurfaceChirality
)


def measure_surfaces(session: AlignSession, shapes: Shapes) -> list[SurfaceChirality]:
    """Return the chirality of every surface, :data:`NO_CHIRALITY` of those that cannot be measured.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    """
    every = range(len(shapes.names))
    known = {i: found for i, found in enumerate(shapes.chirality) if found is not None}
    wanted = {i: wanted_file(MEASURING, session, shapes, i) for i in every if i not in known}
    found = known | dict(compute_surfaces(MEASURING, session, shapes, wanted))
    return [found.get(i, NO_CHIRALITY) for i in every]


def compute_surfaces(
    job: Job[T], session: AlignSession, shapes: Shapes, wanted: Mapping[int, Wanted]
) -> Results[int, T]:
    """Return what a job makes of files that were read before, by position of the shape.

    Raises
    ------
    CollectionError
        As :func:`refuse_lost`.
    """
    found = session.compute(job, wanted, time_limit_s=session.run.shape_time_limit_s)
    failures = session.store.failures(job.kind)
    refuse_lost(shapes, (i for i in found.failures if failures[wanted[i].key].crashed))
    return found


def refuse_lost(shapes: Shapes, failed: Iterable[int]) -> None:
    """Refuse to go on where one of the files on which the machine failed is not the one that was read first.

    A result without it would be that of other shapes than its pairs, and one with it could not be written.

    Raises
    ------
    CollectionError
        Naming the file.
    """
    for i in failed:
        try:
            is_same = hash_shape(shapes.files[i]) == shapes.digests[i]
        except InputError:
            is_same = False
        if not is_same:
            raise CollectionError(
                f"{location(shapes.files[i])}: has changed or vanished since the run began. Its poses would be those "
                "of another shape, so the run ends. Run again: what is finished is in the store, and a file that is "
                "not there is left out"
            )


def wanted_file(job: Job[T], session: AlignSession, shapes: Shapes, i: int) -> Wanted:
    """Return what a job of a shape's file, which was read before, its name, digest and cleaning is wanted on."""
    return Wanted(
        key=job.key({}, shapes.keys[i]),
        label=shapes.names[i],
        arguments={
            "path": shapes.files[i],
            "name": shapes.names[i],
            "digest": shapes.digests[i],
            "cleaning": shapes.cleaning[i].again,
        },
    )
