"""Which shapes are incomplete: those that a person names, and those that the others show to be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.engine.store.records import Record
from collalign.options import AUTO, NEVER, AlignOptions, AlignSession
from collalign.products.collection import DOUBT, Collection
from collalign.products.shapes import Constraints, Shapes
from collalign.stages.incomplete.add import MAX_PARTNERS, place_on
from data_tools.errors import InputError

#: Said of shapes that a person named.
TOLD = "as told"
#: A shape is incomplete if at least this share more of its own surface has a counterpart on the others than theirs
#: has on it.
MISSING_SHARE = 0.12
#: And if so much of its own surface has one: a shape of another kind answers to nothing.
EXPLAINED_SHARE = 0.75
#: Fewer shapes cannot tell which of them is incomplete.
MIN_SHAPES = 4


def told_incomplete(options: AlignOptions, names: Sequence[str]) -> dict[int, str]:
    """Return the positions of the shapes that ``options.incomplete`` names.

    Raises
    ------
    InputError
        If there is no shape of a name.
    """
    if options.incomplete in (AUTO, NEVER):
        return {}
    asked = [name.strip() for name in options.incomplete.split(",") if name.strip()]
    unknown = sorted(set(asked) - set(names))
    if unknown:
        raise InputError(
            f"incomplete: no aligned shape is called {unknown[0]!r}; names are the files' names without suffix"
        )
    return {names.index(name): TOLD for name in sorted(set(asked))}


def find_incomplete(
    session: AlignSession, shapes: Shapes, aligned: Collection, constraints: Constraints
) -> dict[int, str]:
    """Return the shapes in doubt that fit the others better as a part of them, and why.

    Only doubtful poses are looked into: a shape that matches the others as a whole needs nothing else.

    Parameters
    ----------
    session : Session
        Its group is decided.
    shapes : Shapes
    aligned : Collection
        All of them, as if they were complete.
    constraints : Constraints
    """
    sure = np.flatnonzero(aligned.confidence >= DOUBT)
    doubtful = [i for i in np.flatnonzero(aligned.confidence < DOUBT).tolist() if i not in constraints.fixed]
    if session.options.incomplete != AUTO or len(sure) < MIN_SHAPES or not doubtful:
        return {}
    partners = np.array(sorted(sorted(sure.tolist(), key=lambda i: shapes.keys[i])[:MAX_PARTNERS]))
    found = place_on(session, shapes, doubtful, partners, aligned.transforms[partners], Constraints())
    return {i: reason for i, record in found.items() if (reason := why_incomplete(record))}


def why_incomplete(record: Record) -> str:
    """Return why a shape counts as incomplete, from its best pose on others; empty where it does not."""
    theirs, own = np.median(np.asarray(record["overlaps"]), axis=0)
    if own < EXPLAINED_SHARE or own - theirs < MISSING_SHARE:
        return ""
    return f"{1.0 - theirs:.0%} of the others' surfaces have no counterpart on it, {1.0 - own:.0%} of its own"
