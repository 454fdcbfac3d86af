"""Aligns shapes of one kind together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

from numpy.typing import ArrayLike

from collalign.driver.made import collected
from collalign.engine.store_file import FINISHED
from collalign.options import AlignSession
from collalign.output.collection import Collection
from collalign.products.own import Own
from collalign.products.pair import FormerPairs
from collalign.products.shapes import Shapes
from collalign.stages import steps
from collalign.stages.incomplete.detect import named_incomplete
from collalign.stages.kinds.plan import (
    options_of_kind,
)
from collalign.stages.own_knowledge import (
    given_constraints,
    own_notes,
    own_points,
    with_marks,
    with_own_samples,
)
from collalign.stages.pieces import Pieces, pieces_that_match
from collalign.stages.posing import pose_all
from collalign.stages.shape_stage import decided_reading, prepare_shapes
from collalign.stages.steps import Run
from data_tools.io.listing import FolderListing
from data_tools.notes import Note
from data_tools.surface.extra import ExtraSurface


@dataclass(frozen=True, kw_only=True, eq=False)
class KindTask:
    """Shapes of one kind, what is known of them, and the session that aligns them together."""

    session: AlignSession
    listing: FolderListing
    fixed: Mapping[str, ArrayLike]
    kept: Mapping[str, ArrayLike]
    former: FormerPairs | None
    incomplete: frozenset[str]
    own: Own

    def some(self, chosen: Sequence[int], *, has_reference: bool) -> KindTask:
        """Return the task of some of the shapes, by position; directions are those of the kind of the reference."""
        listing = self.listing.some(chosen)
        names = {*listing.names}
        session = self.session
        former = None if self.former is None else self.former.some(chosen)
        return KindTask(
            session=replace(
                session,
                options=options_of_kind(session.options, names, has_reference=has_reference),
            ),
            listing=listing,
            fixed={name: pose for name, pose in self.fixed.items() if name in names},
            kept={name: pose for name, pose in self.kept.items() if name in names},
            former=former if former is not None and former.num_shapes else None,
            incomplete=self.incomplete & names,
            own=self.own.some(names),
        )


def align_one(task: KindTask) -> Collection:
    """Align shapes of one kind."""
    session, listing, own, times_s = task.session, task.listing, task.own, dict[str, float]()
    with steps.timed(session, times_s, "shapes"):
        files = dict(zip(listing.names, listing.files, strict=True))
        given = own_points(own, files, session.options.cleaning)
        session = with_marks(with_own_samples(session, given), own)

        shapes = prepare_shapes(session, listing, given)
        decided = decided_reading(session, shapes)
        if decided is not session:
            session, shapes = decided, prepare_shapes(decided, listing, given)

        def read(
            pieces: Pieces, extra: Mapping[str, ExtraSurface] = MappingProxyType({})
        ) -> Shapes:
            return prepare_shapes(session, listing, given, extra, pieces)

        pieces = pieces_that_match(session, shapes, listing.names, read)
        shapes = read(pieces) if pieces else shapes
        constraints = given_constraints(shapes, session.options, own, task.fixed, task.kept)
    run = Run(
        session=session,
        shapes=shapes,
        read_without=partial(read, pieces),
        constraints=constraints,
        former=task.former,
        times_s=times_s,
    )
    missing = named_incomplete(session.options, shapes.names, {*task.incomplete} & {*shapes.names})
    run, matched, posed = pose_all(run, missing)
    session.enter(FINISHED)
    of_pieces = (Note("components-joined", tuple(pieces)),) if pieces else ()
    matched = replace(
        matched,
        notes=(
            *own_notes(own, given, run.constraints, posed.rotations),
            *of_pieces,
            *matched.notes,
        ),
    )
    found = collected(run, matched, posed, listing)
    return replace(found, own=own.kinds)
