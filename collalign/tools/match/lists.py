"""Maps of deformable surfaces for a list of pairs: shapes are prepared once each, pairs matched, all in the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from collalign.engine.jobs.job import Job, Wanted
from collalign.engine.session import Session
from collalign.engine.store.records import Record
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.surface.spectral_shape import SpectralShape
from collalign.nonrigid.surface.tips import Tips
from collalign.products.shapes import Excluded
from collalign.tools.match.nonrigid import match_prepared
from collalign.tools.match.prepare import prepare_file
from data_tools.arrays import Holds
from data_tools.errors import InputError, StoreError
from data_tools.io.files import existing_file
from data_tools.io.source import hash_source


@dataclass(frozen=True, kw_only=True)
class MapOptions:
    """What decides the maps of a list of pairs."""

    matching: NonrigidOptions
    surface: SurfaceOptions


@dataclass(frozen=True, kw_only=True)
class FoundMap:
    """A map as the bytes of the two files that :meth:`collalign.nonrigid.NonrigidMatch.save` writes."""

    npz: bytes
    text: bytes
    confidence: Annotated[float, Holds(nan=True)]


def read_pairs(path: Path | str, folder: Path | str | None = None) -> list[tuple[Path, Path]]:
    """Read a pair list: one pair a line, target and source file separated by white space; ``#`` starts a comment.

    Parameters
    ----------
    path : Path or str
    folder : Path or str, optional
        Where relative names are; the list's own folder by default.

    Raises
    ------
    InputError
        If a line does not hold two names, or there is none.
    """
    path = existing_file(Path(path))
    base = Path(folder) if folder is not None else path.parent
    pairs = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) != 2:
            raise InputError(f"{path}, line {number}: expected a target and a source file, got {line.strip()!r}")
        pairs.append((base / words[0], base / words[1]))
    if not pairs:
        raise InputError(f"{path}: holds no pairs")
    return pairs


def match_surfaces(session: Session[MapOptions], pairs: Sequence[tuple[Path, Path]]) -> list[FoundMap | Excluded]:
    """Return the map of every pair of files (target, source), or why there is none; no pair stops the others."""
    options, time_limit_s = session.options, session.run.pair_time_limit_s
    files = dict.fromkeys(file for pair in pairs for file in pair)
    shapes = session.compute(
        PREPARING,
        {file: _wanted_shape(file, options.surface) for file in files},
        time_limit_s=session.run.shape_time_limit_s,
        retry="all",
    )
    wanted = {}
    for target, source in pairs:
        ends = shapes.shared(target), shapes.shared(source)
        if target in shapes and source in shapes:
            wanted[target, source] = Wanted(
                key=MATCHING.key(options.matching, *(end.key for end in ends)),
                label=_label(target, source),
                arguments={"target": ends[0], "source": ends[1], "options": options.matching},
            )
    maps = session.compute(MATCHING, wanted, time_limit_s=time_limit_s, retry="all")
    reasons = {pair: shapes.failures[end] for pair in pairs for end in reversed(pair) if end in shapes.failures}
    reasons |= maps.failures
    return [Excluded(file=_label(*pair), reason=reasons[pair]) if pair in reasons else maps[pair] for pair in pairs]


def _label(target: Path, source: Path) -> str:
    return f"{target.name} - {source.name}"


def _digest(file: Path) -> str | None:
    """Return the digest of a file's content; None for one that cannot be read, which fails in its task."""
    try:
        return hash_source(file)
    except InputError:
        return None


def _wanted_shape(file: Path, options: SurfaceOptions) -> Wanted:
    """Return what is wanted of a file; one that cannot be read has a key of its own."""
    digest, settings = _digest(file), {"surface": options, "suffix": file.suffix.lower(), "name": file.stem}
    return Wanted(
        key=PREPARING.key(settings, digest or f"no content {file}"),
        label=file.name,
        arguments={"file": file, "options": options, "digest": digest},
    )


def _prepare(file: Path, options: SurfaceOptions, digest: str | None) -> Record:
    prepared = prepare_file(file, options, digest=digest)
    record = {field.name: getattr(prepared, field.name) for field in fields(prepared) if field.name != "tips"}
    tips = {f"tips_{field.name}": getattr(prepared.tips, field.name) for field in fields(Tips)}
    return record | tips | {"notes": list(prepared.notes)}


def _match(target: SpectralShape, source: SpectralShape, options: NonrigidOptions) -> FoundMap:
    match = match_prepared(target, source, options)
    return FoundMap(npz=match.npz_bytes(), text=match.text_bytes(), confidence=float(match.confidence))


def _prepared(record: Record, key: str) -> SpectralShape:
    """Return a prepared shape; the pair functions check that two of them fit."""
    try:
        arrays = {field.name: record[field.name] for field in fields(SpectralShape) if field.name != "tips"}
        tips = Tips(**{field.name: record[f"tips_{field.name}"] for field in fields(Tips)})
        return SpectralShape(**arrays | {"tips": tips, "notes": tuple(arrays["notes"])})
    except (KeyError, TypeError) as error:
        raise StoreError(f"stored shape {key}: {error}") from None


#: Prepare a shape and match two. The version changes whenever the same files and options would give others.
PREPARING = Job(kind="shapes", version="map-4", run=_prepare, reader=_prepared)
MATCHING = Job(kind="pairs", version="map-5", run=_match, reader=FoundMap)
