"""Many pairs: one map per pair of a list, written as they are found; a second run does what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from collalign.nonrigid.match import match_prepared
from collalign.nonrigid.options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.prepare import prepare_file
from data_tools.errors import InputError
from data_tools.io.files import existing_file
from data_tools.threads import one_blas_thread

#: Prepared shapes held in memory; the others are read from the cache.
_NUM_HELD = 8


@dataclass(frozen=True, kw_only=True)
class PairOutcome:
    """What became of one pair.

    Attributes
    ----------
    target, source : Path
    npz, text : Path
        Where its map is (or would be).
    state : {"matched", "kept", "failed"}
        Found now, found by an earlier run, or not possible.
    reason : str
        Why it failed.
    confidence : float
        Of a map found now, else NaN.
    """

    target: Path
    source: Path
    npz: Path
    text: Path
    state: str
    reason: str = ""
    confidence: float = float("nan")


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


@one_blas_thread()
def match_pairs(
    pairs: Iterable[tuple[Path, Path]],
    out: Path | str,
    *,
    options: NonrigidOptions | None = None,
    surface_options: SurfaceOptions | None = None,
    cache: Path | str | None = None,
    report: Callable[[PairOutcome], None] | None = None,
) -> list[PairOutcome]:
    """Match pairs of files and write ``TARGET__SOURCE.npz`` and ``.txt`` for each, as ``NonrigidMatch`` does.

    A pair whose two files exist is kept as it is, so that an interrupted run continues where it stopped. Prepared
    shapes are kept in ``out/prepared``. A pair that fails (unreadable file, too few vertices) does not stop others.

    Parameters
    ----------
    pairs : iterable of (target, source)
    out : Path or str
    options, surface_options : optional
    cache : Path or str, optional
        Folder for the prepared shapes, ``out/prepared`` by default.
    report : callable, optional
        Called after every pair.
    """
    folder = Path(out)
    kept = folder / "prepared" if cache is None else Path(cache)
    prepared = lru_cache(maxsize=_NUM_HELD)(lambda file: prepare_file(file, surface_options, cache=kept))
    outcomes = []
    for target, source in pairs:
        stem = f"{Path(target).stem}__{Path(source).stem}"
        outcome = PairOutcome(
            target=target, source=source, npz=folder / f"{stem}.npz", text=folder / f"{stem}.txt", state="kept"
        )
        if not (outcome.npz.exists() and outcome.text.exists()):
            try:
                match = match_prepared(prepared(target), prepared(source), options)
            except InputError as error:
                outcome = replace(outcome, state="failed", reason=str(error))
            else:
                match.save_npz(outcome.npz)
                match.save_text(outcome.text)
                outcome = replace(outcome, state="matched", confidence=match.confidence)
        outcomes.append(outcome)
        if report is not None:
            report(outcome)
    return outcomes
