"""Maps of deformable surfaces for a list of pairs: shapes are prepared once each, pairs matched, all in the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from collalign.engine.jobs.run import SharedTable
from collalign.engine.session import Session
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.nonrigid.options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.surface.spectral import SpectralShape
from collalign.nonrigid.surface.tips import Tips
from collalign.products.shapes import Excluded
from collalign.tools.match.nonrigid import match_prepared
from collalign.tools.match.prepare import prepare_file
from data_tools.errors import InputError, StoreError
from data_tools.io.files import existing_file
from data_tools.io.source import hash_source

#: Changes whenever the same files and options would give other prepared shapes, or other maps.
MAP_VERSION = "map-3"


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
    confidence: float


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
    digests = {file: _digest(file) for file in files}
    keys = {file: _shape_key(file, digests[file], options.surface) for file in files}
    shape_tasks = {key: (file.name, (file, options.surface, digests[file])) for file, key in keys.items()}
    bad = session.compute("shapes", _prepare, shape_tasks, time_limit_s=session.run.shape_time_limit_s, retry="all")
    ends = [(keys[target], keys[source]) for target, source in pairs]
    pair_keys = [fingerprint(MAP_VERSION, options.matching, *end) for end in ends]
    labels = [f"{target.name} - {source.name}" for target, source in pairs]
    tasks = {
        key: (label, (*end, options.matching))
        for key, label, end in zip(pair_keys, labels, ends, strict=True)
        if not bad.keys() & set(end)
    }
    with session.shared_table("shapes", keys.values() - bad.keys()) as table:
        failed = session.compute("pairs", _match, tasks, time_limit_s=time_limit_s, shared=table, retry="all")
    found: list[FoundMap | Excluded] = []
    for key, label, end in zip(pair_keys, labels, ends, strict=True):
        reasons = [failures[k].reason for failures in (bad, failed) for k in (*end, key) if k in failures]
        found.append(
            Excluded(file=label, reason=reasons[0]) if reasons else FoundMap(**session.store.require("pairs", key))
        )
    return found


def _digest(file: Path) -> str | None:
    """Return the digest of a file's content; None for one that cannot be read, which fails in its task."""
    try:
        return hash_source(file)
    except InputError:
        return None


def _shape_key(file: Path, digest: str | None, options: SurfaceOptions) -> str:
    """Return the key of a prepared shape; a file that cannot be read has one of its own."""
    content = digest or f"no content {file}"
    return fingerprint(MAP_VERSION, {"surface": options, "suffix": file.suffix.lower(), "name": file.stem}, content)


def _prepare(task: tuple[Path, SurfaceOptions, str | None]) -> Record:
    file, options, digest = task
    prepared = prepare_file(file, options, digest=digest)
    record = {field.name: getattr(prepared, field.name) for field in fields(prepared) if field.name != "tips"}
    tips = {f"tips_{field.name}": getattr(prepared.tips, field.name) for field in fields(Tips)}
    return record | tips | {"notes": list(prepared.notes)}


def _match(task: tuple[str, str, NonrigidOptions], shared: SharedTable) -> Record:
    target, source = (_prepared(shared[key], key) for key in task[:2])
    match = match_prepared(target, source, task[2])
    return {"npz": match.npz_bytes(), "text": match.text_bytes(), "confidence": float(match.confidence)}


def _prepared(record: Record, key: str) -> SpectralShape:
    """Return a prepared shape; the pair functions check that two of them fit."""
    try:
        arrays = {field.name: record[field.name] for field in fields(SpectralShape) if field.name != "tips"}
        tips = Tips(**{field.name: record[f"tips_{field.name}"] for field in fields(Tips)})
        return SpectralShape(**arrays | {"tips": tips, "notes": tuple(arrays["notes"])})
    except (KeyError, TypeError) as error:
        raise StoreError(f"stored shape {key}: {error}") from None
