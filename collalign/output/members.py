"""Whose shapes count in statistics: neither doubtful nor incomplete ones, unless they are asked for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.confidence.reliability_model import expected_right
from collalign.output.collection_data import CollectionData
from collalign.wording import note_text, reason_text
from data_tools.arrays import IntArray
from data_tools.checks import check_number
from data_tools.embedding.copies import Copies
from data_tools.names import known_names
from data_tools.notes import Note

#: The table of those who do not count, next to statistics that are written.
LEFT_OUT_FILE = "left_out.csv"
#: The reason of a shape that is stated less surely than a share of right poses asks for.
LESS_SURE = "less-sure"


@dataclass(frozen=True, kw_only=True, eq=False)
class Members:
    """Who counts in the statistics of a collection.

    Attributes
    ----------
    chosen : ndarray of int
        Positions of those who do, ascending.
    left_out : tuple of (str, str)
        Name of each other shape, and the code of why it does not count.
    copies : tuple of Copies
        Shapes that count and are one and the same surface.
    """

    chosen: IntArray
    left_out: tuple[tuple[str, str], ...]
    copies: tuple[Copies, ...] = ()

    @property
    def notes(self) -> tuple[Note, ...]:
        """Who was left out and why; none where all count."""
        if not self.left_out:
            return ()
        names, reasons = zip(*self.left_out, strict=True)
        return (Note("left-out-of-statistics", names, {"reasons": reasons}),)

    def without(self, left_out: Iterable[tuple[str, str]]) -> Members:
        """Return the same with further shapes left out, by name, for the codes of reasons."""
        return replace(self, left_out=(*self.left_out, *left_out))

    def not_said_by(self, notes: Iterable[Note]) -> list[Note]:
        """Return the notes of an alignment without that of doubtful shapes, where all of these are left out."""
        names = {name for name, _ in self.left_out}
        return [note for note in notes if note.code != "doubtful" or not {*note.shapes} <= names]

    @property
    def table(self) -> list[list[str]]:
        """The same as a table with its heading."""
        return [["name", "reason"], *([name, reason_text(why)] for name, why in self.left_out)]

    def too_few(self, least: int) -> str:
        """Return why nothing can be computed of fewer than so many; empty where there are enough."""
        if len(self.chosen) >= least:
            return ""
        words = f"{len(self.chosen)} shapes are complete and sure, at least {least} are needed"
        return f"{words}; left out: {self._listed}" if self.left_out else words

    @property
    def _listed(self) -> str:
        return ", ".join(f"{name} ({reason_text(reason)})" for name, reason in self.left_out)


@dataclass(frozen=True, kw_only=True, eq=False)
class Selection:
    """Shapes that are kept so that a share of their poses is expected to be right.

    Attributes
    ----------
    names : tuple of str
        Those that are kept.
    chosen : ndarray of int, shape (n,)
        Their positions, ascending: ``collection.some(selection.chosen)``.
    total : int
        Shapes of the collection.
    least_confidence : float
        All that are stated at this or more are kept; infinite where none is.
    right : float
        The share of those kept that is expected to be right; NaN where none is kept.
    """

    names: tuple[str, ...]
    chosen: IntArray
    total: int
    least_confidence: float
    right: float

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __str__(self) -> str:
        return note_text(self.note)

    @property
    def note(self) -> Note:
        """How many are kept, and what share of them is expected to be right."""
        if not self.names:
            return Note("selected-none", values={"total": self.total})
        values = {"kept": len(self), "total": self.total}
        return Note(
            "selected", values={**values, "least": self.least_confidence, "share": self.right}
        )


def select_right(collection: CollectionData, right: float) -> Selection:
    """Keep as many shapes as possible of which a share is expected to be right, the surest first.

    The share comes from how often poses that were stated at a confidence were right
    (:mod:`collalign.confidence.reliability_model`). Shapes without a confidence, as the only one of its kind, are not
    kept.

    Parameters
    ----------
    collection : CollectionData
    right : float
        The share, between 0 and 1.

    Raises
    ------
    OptionsError
        If it is no share.
    """
    check_number("right", right, lower=0.0, upper=1.0)
    confidence = collection.confidence
    shares = expected_right(confidence)
    levels = np.unique(confidence[~np.isnan(confidence)])
    means = np.array([float(shares[confidence >= level].mean()) for level in levels])
    enough = np.flatnonzero(means >= right)
    least = float(levels[enough[0]]) if len(enough) else np.inf
    chosen = np.flatnonzero(confidence >= least)
    return Selection(
        names=tuple(collection.names[at] for at in chosen),
        chosen=chosen,
        total=len(collection),
        least_confidence=least,
        right=float(means[enough[0]]) if len(enough) else np.nan,
    )


def statistics_members(
    collection: CollectionData,
    *,
    exclude: Sequence[str] = (),
    include_doubtful: bool = False,
    include_incomplete: bool = False,
    one_part: bool = True,
    right: float | None = None,
) -> Members:
    """Decide who counts in statistics.

    Parameters
    ----------
    collection : CollectionData
    exclude : sequence of str
        Names of shapes that do not count, whatever is known of them.
    include_doubtful, include_incomplete : bool
        Let shapes whose pose is in doubt, or of which parts are missing, count as well.
    one_part : bool
        Whether shapes of other parts than the largest stay out: their poses do not compare.
    right : float, optional
        Whether only those count that :func:`select_right` keeps.
    """
    reasons = np.full(len(collection), "", dtype=object)
    known = np.asarray(np.isfinite(collection.confidence))
    if (
        not include_doubtful and known.any()
    ):  # without any confidence, as of a baseline, there is nothing to doubt
        reasons[collection.is_doubtful] = "doubtful"
    if not include_incomplete:
        reasons[collection.is_incomplete] = "incomplete"
    if one_part:
        reasons[np.setdiff1d(np.arange(len(collection)), main_part(collection))] = "other-part"
    if right is not None:
        kept = select_right(collection, right).chosen
        reasons[np.setdiff1d(np.arange(len(collection)), kept)] = LESS_SURE
    reasons[collection.is_alone] = "alone"
    excluded = known_names("exclude", exclude, collection.names)
    reasons[[collection.index(name) for name in excluded.values()]] = "excluded"
    left_out = {collection.names[at]: str(reasons[at]) for at in np.flatnonzero(reasons != "")}
    counted = [
        replace(one, names=tuple(name for name in one.names if name not in left_out))
        for one in collection.copies
    ]
    return Members(
        chosen=np.flatnonzero(reasons == ""),
        left_out=tuple(left_out.items()),
        copies=tuple(one for one in counted if len(one.names) > 1),
    )


def main_part(collection: CollectionData) -> IntArray:
    """Return positions (n,) of the shapes of the largest part: between parts no distance means anything."""
    values, counts = np.unique(collection.part_numbers, return_counts=True)
    return np.flatnonzero(collection.part_numbers == values[counts.argmax()])
