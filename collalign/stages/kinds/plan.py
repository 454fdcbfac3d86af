"""Which shapes are aligned with each other: all, or kind by kind, as a caller, an earlier run or the shapes say."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.options import ALL, AUTO, NEVER, AlignOptions, AlignSession
from collalign.products.pair import FormerPairs
from collalign.products.shapes import Shapes
from collalign.stages.kinds.find import alikeness, find_kinds
from collalign.stages.kinds.grouping import FEWEST_OF_KIND
from collalign.stages.pieces import assembled_shapes
from collalign.stages.shape_stage import decided_reading, prepare_shapes
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.sampling import OwnPoints
from data_tools.errors import InputError, OptionsError
from data_tools.io.files import distinct_forms
from data_tools.io.listing import FolderListing
from data_tools.names import by_known_names


@dataclass(frozen=True, kw_only=True, eq=False)
class KindPlan:
    """The kinds that are aligned one by one.

    Attributes
    ----------
    shapes : Shapes
        All shapes that can be read.
    members : tuple of ndarray of int, each (n,)
        Positions of the shapes of each kind.
    names : tuple of str
        What each kind is called.
    confidence : tuple of float
        How likely each is a kind of its own; NaN where the caller said so.
    log_odds : ndarray, shape (N, N)
        How alike any two shapes are.
    """

    shapes: Shapes
    members: tuple[IntArray, ...]
    names: tuple[str, ...]
    confidence: tuple[float, ...]
    log_odds: FloatArray

    def kind_of(self, name: str) -> int:
        """Return the kind of a shape; the first one where the shape is left out."""
        at = self.shapes.names.index(name) if name in self.shapes.names else -1
        return next((k for k, own in enumerate(self.members) if at in own), 0)


#: The value of ``kinds`` by which the folders of the names say them.
BY_FOLDER = "folder"


def kinds_of(kinds: Mapping[str, str] | str, names: Sequence[str]) -> dict[str, str]:
    """Return the kind of each shape by name, of those whose kind is known.

    Parameters
    ----------
    kinds : mapping of name to str, or str
        Names may agree nearly. ``"folder"`` takes the first folder of each name; ``""`` says nothing.
    names : sequence of str
        Of all shapes.

    Raises
    ------
    InputError
        If a name is unknown, or no shape lies in a folder.
    OptionsError
        If it is neither.
    """
    if isinstance(kinds, Mapping):
        found = by_known_names("kinds", kinds, names)
        return {name: str(kind) for name, kind in found.items() if kind}
    if not kinds:
        return {}
    if kinds != BY_FOLDER:
        raise OptionsError(
            f"kinds: expected {BY_FOLDER!r} or the kind of each shape by its name, got {kinds!r}"
        )
    folders = {name: name.split("/")[0] for name in names if "/" in name}
    if not folders:
        raise InputError(
            "kinds: no shape lies in a folder of the folder, so none says a kind. Name the folder above, with "
            "--recursive (in Python recursive=True)"
        )
    return folders


def looks_for_kinds(options: AlignOptions, num_shapes: int) -> bool:
    """Return whether kinds are looked for: nobody forbids it, and there are enough shapes.

    Not where shapes are scans of one object, vertices are mapped between all, or no confidence is known.
    """
    if options.clusters > 1:
        return True
    return (
        options.clusters == 0
        and options.synchronization == "robust"
        and options.incomplete != ALL
        and not options.deformable
        and num_shapes >= 2 * FEWEST_OF_KIND
    )


def read_all_kinds(
    session: AlignSession, listing: FolderListing, own: Mapping[str, OwnPoints]
) -> tuple[AlignSession, Shapes]:
    """Return the shapes of all kinds as they are told apart, and the session that reads all of them alike.

    Walls in some files make no other kind of them. Objects that are assembled of components are read by all of
    these: large boxes look alike.

    Parameters
    ----------
    session : Session
    listing : FolderListing
    own : mapping of str to OwnPoints
        Samples and invariants that are given, by name.
    """
    shapes = prepare_shapes(session, listing, own)
    decided = decided_reading(session, shapes)
    if decided is not session:
        shapes = prepare_shapes(decided, listing, own)
    if assembled := assembled_shapes(decided, shapes):
        shapes = prepare_shapes(decided, listing, own, pieces=dict.fromkeys(assembled, "all"))
    return decided, shapes


def plan_kinds(
    session: AlignSession,
    shapes: Shapes,
    former: FormerPairs | None,
    given: Mapping[str, str],
) -> KindPlan | None:
    """Return the kinds of shapes, None where all are aligned together.

    Parameters
    ----------
    session : Session
        With ``options.clusters`` as the caller asked.
    shapes : Shapes
    former : FormerPairs, optional
        Of an earlier run, whose kinds stay.
    given : mapping of str to str
        The kind of each shape by name; of shapes that it lacks the kind is found.
    """
    known, called = _known(shapes, former, given)
    num = session.options.clusters if session.options.clusters > 1 else 0
    if known is not None and (known >= 0).all():
        found_labels, log_odds = known, None
        confidence = [float("nan")] * len(called)
    else:
        found = find_kinds(session, shapes, num=num, known=known)
        if found is None:
            return None
        found_labels, log_odds = found.labels, found.log_odds
        confidence = found.confidence.tolist()
        called = _names_of(found.labels, known, called)
    if found_labels.max() == 0:
        return None
    members = tuple(np.flatnonzero(found_labels == k) for k in range(found_labels.max() + 1))
    if former is not None and former.kinds:
        stated = {kind.called: kind.confidence for kind in former.kinds}
        confidence = [stated.get(name, own) for name, own in zip(called, confidence, strict=True)]
    return KindPlan(
        shapes=shapes,
        members=members,
        names=tuple(called),
        confidence=tuple(confidence),
        log_odds=alikeness(shapes) if log_odds is None else log_odds,
    )


def options_of_kind(
    options: AlignOptions, names: Collection[str], *, has_reference: bool
) -> AlignOptions:
    """Return the options of shapes of one kind; the named frame is that of the kind of the reference."""
    if not has_reference:
        options = replace(options, reference="", up="", front="", origin="")
    if options.incomplete not in (ALL, AUTO, NEVER):
        named = [name for name in options.incomplete.split(",") if name in names]
        options = replace(options, incomplete=",".join(named) or NEVER)
    return options


def settled_kinds(
    former: FormerPairs | None, kinds: Sequence[Sequence[str]], stay: Collection[str]
) -> dict[int, float]:
    """Return the kinds whose frame stays, because poses in it do, and how many pairs had agreed on it.

    Parameters
    ----------
    former : FormerPairs, optional
        Of an earlier run.
    kinds : sequence of sequence of str
        Names of the shapes of each kind.
    stay : collection of str
        Shapes whose poses stay.
    """
    frames = [] if former is None else [kind.frame for kind in former.kinds]
    held = [k for k, names in enumerate(kinds) if {*names} & {*stay}]
    return {k: frames[n] if n < len(frames) else 1.0 for n, k in enumerate(held)}


def distinct_called(names: Sequence[str]) -> list[str]:
    """Return names of kinds made distinct by a number: of a kind whose shapes could not be matched."""
    return distinct_forms(names, str)


def _known(
    shapes: Shapes, former: FormerPairs | None, given: Mapping[str, str]
) -> tuple[IntArray | None, list[str]]:
    """Return the kinds that are known, numbered by first member and -1 of others, and what they are called."""
    of_shape = {name: given.get(name, "") for name in shapes.names}
    if former is not None and former.num_shapes:
        for kind in former.kinds:
            of_shape |= {
                shapes.names[i]: kind.called for i in kind.shapes.tolist() if i < len(shapes.names)
            }
        if not former.kinds and not given:
            of_shape |= dict.fromkeys(shapes.names[: former.num_shapes], "kind 1")
    called = [*dict.fromkeys(name for name in of_shape.values() if name)]
    if not called:
        return None, []
    number = {name: k for k, name in enumerate(called)}
    return np.array([number.get(of_shape[name], -1) for name in shapes.names]), called


def _names_of(labels: IntArray, known: IntArray | None, called: Sequence[str]) -> list[str]:
    """Return what kinds that were found are called: as those known that they are, the others by number."""
    taken, names = {*called}, list[str]()
    for kind in range(int(labels.max()) + 1):
        own = [] if known is None else sorted({*known[labels == kind].tolist()} - {-1})
        if own:
            names.append(called[own[0]])
            continue
        number = next(
            n
            for n in range(len(names) + 1, len(names) + len(taken) + 2)
            if f"kind {n}" not in taken
        )
        taken.add(f"kind {number}")
        names.append(f"kind {number}")
    return names
