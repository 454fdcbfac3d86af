"""What stays of a result when the alignment is repeated otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from collalign.align import align_listing
from collalign.analysis.procrustes import pose_changes
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.output.loading import load
from collalign.output.members import Members, statistics_members
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.checks import as_options, check_count, check_kinds
from data_tools.errors import OptionsError
from data_tools.io.listing import FolderListing
from data_tools.options import MIN_POINTS
from data_tools.poses import AGREE_DEG
from data_tools.threads import one_blas_thread


@dataclass(frozen=True, kw_only=True, eq=False)
class Stability:
    """How N shapes fared in V repetitions of their alignment, against the result. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str, length N
    confidence : ndarray, shape (N,)
        Of the result.
    repetitions : tuple of str, length V
        What was changed, in words.
    present : ndarray of bool, shape (V, N)
        Whether the shape took part.
    changes_deg : ndarray, shape (V, N)
        By how much its pose relative to the others differs; NaN where it is reflected differently, absent or alone.
    same_chirality : ndarray of bool, shape (V, N)
        True where absent.
    stay_deg : float
        A pose that changes by at most this stays.
    who : Members
        Whose shapes count in the shares of all together.
    """

    names: tuple[str, ...]
    confidence: FloatArray
    repetitions: tuple[str, ...]
    present: BoolArray
    changes_deg: FloatArray
    same_chirality: BoolArray
    stay_deg: float
    who: Members

    @property
    def known(self) -> BoolArray:
        """Where poses were compared, shape (V, N): present, and with another shape to be compared with."""
        return np.asarray(self.present & ~(np.isnan(self.changes_deg) & self.same_chirality))

    @property
    def pose_stays(self) -> FloatArray:
        """Share of the repetitions in which each pose stays, shape (N,); NaN where it was in none."""
        return _shares(np.nan_to_num(self.changes_deg, nan=np.inf) <= self.stay_deg, self.known)

    @property
    def chirality_stays(self) -> FloatArray:
        """Share of the repetitions in which each shape is reflected as in the result, shape (N,)."""
        return _shares(self.same_chirality, self.known)


def _shares(values: BoolArray, known: BoolArray) -> FloatArray:
    """Return the mean of the known entries of each column, NaN where there is none."""
    counts = known.sum(axis=0)
    return np.where(counts > 0, (values * known).sum(axis=0) / np.maximum(counts, 1), np.nan)


#: Share of the shapes that take part in a repetition with some of them.
SUBSET_SHARE = 0.8


@dataclass(frozen=True, kw_only=True)
class StabilityOptions:
    """Which repetitions are made.

    Parameters
    ----------
    num_points : tuple of int
        Points per shape, one repetition each; the number that the result was made with is left out.
    num_seeds : int
        Repetitions with other seeds.
    num_subsets : int
        Repetitions with some of the shapes, chosen at random.
    include_doubtful : bool
        Let shapes whose pose is in doubt, and incomplete ones, count in the shares of all together.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    num_points: tuple[int, ...] = (32, 64, 128)
    num_seeds: int = 2
    num_subsets: int = 3
    include_doubtful: bool = False

    def __post_init__(self) -> None:
        check_kinds(self)
        for num in self.num_points:
            check_count("num_points", num, lower=MIN_POINTS)
        for name in ("num_seeds", "num_subsets"):
            check_count(name, getattr(self, name), lower=0)


#: One repetition: in words, with which options, of which shapes.
Repetition: TypeAlias = tuple[str, AlignOptions, IntArray]


@one_blas_thread()
def check_stability(
    result: Collection | str | Path,
    *,
    options: StabilityOptions | Mapping[str, Any] | None = None,
    run: RunOptions | Mapping[str, Any] | None = None,
    progress: ProgressFactory | bool = True,
) -> Stability:
    """Repeat the alignment of a result's shapes otherwise, and say what stays of every shape's pose.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that ``collalign align`` wrote.
    options : StabilityOptions or mapping, optional
    run : RunOptions or mapping, optional
        With the store of the result, shapes and pairs are used again, and an interrupted check goes on.
    progress : bool or callable
        As in :func:`collalign.align_collection`.

    Raises
    ------
    InputError
        If the folder holds no result, or an original file has vanished.
    OptionsError
        If no repetition is asked for.

    Notes
    -----
    The sensitivity analysis that Vitek, Manz, Gao, Bloch, Strait and Boyer (Semi-supervised determination of
    pseudocryptic morphotypes using observer-free characterizations of anatomical alignment and shape, Ecology and
    Evolution 7, 2017, PMC5528226) ask of everybody who aligns automatically. Poses set by hand are not
    kept in the repetitions, to test their evidence too. Shapes in doubt and incomplete ones are repeated
    like all others and have their own rows; they do not count in the shares of all together.

    Examples
    --------
    >>> once = {"num_points": (), "num_seeds": 1, "num_subsets": 0}  # quicker than the default
    >>> found = collalign.check_stability("aligned", options=once)
    >>> bool((found.changes_deg < found.stay_deg).all())
    True
    """
    collection = load(result)
    listing = FolderListing(files=collection.source_files(), names=collection.names)
    aligned_with = collection.options
    wanted = as_options("options", options, StabilityOptions)
    plan = list(
        repetitions(replace(aligned_with, reference="", certify=False), len(collection), wanted)
    )
    if not plan:
        raise OptionsError(
            "num_points, num_seeds, num_subsets: no repetition is left that differs from the result"
        )
    doubtful = wanted.include_doubtful
    who = statistics_members(
        collection, include_doubtful=doubtful, include_incomplete=doubtful, one_part=False
    )
    rows = []
    with Session.open(
        aligned_with, as_options("run", run, RunOptions), progress_display(progress)
    ) as session:
        for number, (words, again_with, members) in enumerate(plan, 1):
            shown = _titled(session.progress, f"{words} ({number} of {len(plan)})")
            repeated = replace(session, options=again_with, progress=shown)
            again = align_listing(repeated, listing.some(members), fixed={})
            rows.append(_compared(collection, again))
    present, changes, same = (read_only(np.stack(column)) for column in zip(*rows, strict=True))
    return Stability(
        names=collection.names,
        confidence=collection.confidence,
        repetitions=tuple(words for words, _, _ in plan),
        present=present,
        changes_deg=changes,
        same_chirality=same,
        stay_deg=AGREE_DEG,
        who=who,
    )


def repetitions(
    aligned_with: AlignOptions, num_shapes: int, wanted: StabilityOptions
) -> Iterator[Repetition]:
    """Yield what is repeated, those first that have the most in common with the result.

    Parameters
    ----------
    aligned_with : AlignOptions
        Of the result.
    num_shapes : int
    wanted : StabilityOptions

    Yields
    ------
    Repetition
    """
    every, size = np.arange(num_shapes), max(2, round(SUBSET_SHARE * num_shapes))
    rng = np.random.default_rng(aligned_with.seed)
    for number in range(1, wanted.num_subsets + 1 if size < num_shapes else 1):
        members = np.sort(rng.permutation(num_shapes)[:size])
        yield f"{size} shapes, choice {number}", aligned_with, members
    for seed in islice((seed for seed in count() if seed != aligned_with.seed), wanted.num_seeds):
        yield f"seed {seed}", replace(aligned_with, seed=seed), every
    for num in sorted({*wanted.num_points} - {aligned_with.sampling.num_points}):
        sampling = replace(aligned_with.sampling, num_points=num)
        yield f"{num} points", replace(aligned_with, sampling=sampling), every


def _compared(collection: Collection, again: Collection) -> tuple[BoolArray, FloatArray, BoolArray]:
    """Return a repetition's row of ``present``, ``changes_deg`` and ``same_chirality``."""
    members = np.array([collection.names.index(name) for name in again.names])
    num = len(collection)
    present, changes, same = (
        np.zeros(num, dtype=bool),
        np.full(num, np.nan),
        np.ones(num, dtype=bool),
    )
    present[members] = True
    changes[members], same[members] = pose_changes(
        collection.rotations[members], again.rotations, collection.part_numbers[members]
    )
    return present, changes, same


def _titled(progress: ProgressFactory | None, title: str) -> ProgressFactory | None:
    """Return a progress display that says which repetition it is."""
    if progress is None:
        return None

    def titled(description: str, total: int, **more: Any) -> AbstractContextManager[Any]:
        return progress(f"{title}: {description}", total, **more)

    return titled
