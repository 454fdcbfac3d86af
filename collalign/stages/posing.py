"""Which shapes of a run are posed on each other, which on the others: complete ones, incomplete ones, scans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

from collalign.options import AUTO, MAX_ROUNDS, AlignOptions
from collalign.products.pair import are_weighed
from collalign.stages import steps
from collalign.stages.incomplete.add import with_incomplete
from collalign.stages.incomplete.detect import MIN_SHAPES, OPEN, find_incomplete, turned_out_whole
from collalign.stages.incomplete.grow import IN_DOUBT, align_scans, are_scans
from collalign.stages.steps import Matched, Posed, Run, with_group
from collalign.stages.trust.remedies import MOST_TRIED, may_be_scans
from data_tools.errors import CollectionError, InputError

#: The run of the shapes that are posed, its group decided; their pairs; their poses.
_Answer: TypeAlias = tuple[Run, Matched, Posed]


def looks_for_incomplete(options: AlignOptions) -> bool:
    """Whether nobody said which shapes are incomplete, and all are of one kind."""
    return options.incomplete == AUTO and options.clusters == 1


def pose_all(run: Run, missing: Mapping[int, str]) -> tuple[Matched, Posed]:
    """Pose all shapes; ``missing`` says why some are incomplete: they were called so, or their surface is open."""
    if len(missing) == len(run.shapes.names):
        decided, matched, posed = _pose(run)
        posed = align_scans(with_group(run, matched.group), _judged(decided, matched, posed), missing)
        return replace(matched, notes=()), posed  # they speak of other poses
    matched, posed = _pose_on_complete(run, missing)
    whole = turned_out_whole(posed.incomplete)
    if whole:
        matched, posed = _pose_on_complete(run, {i: why for i, why in missing.items() if i not in whole})
    return matched, posed


def _pose_on_complete(run: Run, missing: Mapping[int, str]) -> tuple[Matched, Posed]:
    """Pose complete shapes and judge that, then the others on them, or all on each other."""
    session, names = run.session, run.shapes.names
    decided, matched, posed = _pose_others(run, missing)
    if {*missing.values()} <= {OPEN} and looks_for_incomplete(session.options):
        missing, (decided, matched, posed) = _without_found(run, missing, (decided, matched, posed))
    posed = _judged(decided, matched, posed)
    if missing:
        posed = with_incomplete(with_group(run, matched.group), posed, missing)
    elif _asks_for_scans(decided, posed):
        scans = align_scans(with_group(run, matched.group), posed, dict.fromkeys(range(len(names)), IN_DOUBT))
        if are_scans(scans):
            posed, matched = scans, replace(matched, notes=())
    return matched, posed


def _without_found(run: Run, missing: Mapping[int, str], answer: _Answer) -> tuple[dict[int, str], _Answer]:
    """Return the shapes that turn out to be incomplete, and the others posed without them; in rounds.

    Incomplete shapes among complete ones may spoil poses, and so hide others. Shapes that bend so much that maps were
    asked tell nothing.
    """
    missing = dict(missing)
    for _ in range(0 if are_weighed(answer[1].pairs) else MAX_ROUNDS):
        posed = answer[2]
        kept = [i for i in range(len(run.shapes.names)) if i not in missing]
        with run.stage("incomplete shapes"):
            found = find_incomplete(run.session, run.shapes.some(kept), posed.pairs, posed.transforms)
        fresh = {kept[n]: reason for n, reason in found.items() if kept[n] not in run.constraints.fixed}
        if not fresh or len(kept) - len(fresh) < MIN_SHAPES:
            break
        missing |= fresh
        answer = _pose_others(run, missing)
    return missing, answer


def _asks_for_scans(run: Run, posed: Posed) -> bool:
    """Whether shapes are tried as scans of which none is complete: nobody said otherwise, and most are in doubt."""
    options = run.session.options
    return (
        looks_for_incomplete(options)
        and options.synchronization == "robust"
        and not options.deformable
        and not run.constraints.fixed
        and len(run.shapes.names) <= MOST_TRIED
        and may_be_scans(run.shapes, posed.confidence_but_for_sides)
    )


def _pose_others(run: Run, missing: Mapping[int, str]) -> _Answer:
    """Pose the shapes that are not incomplete."""
    if not missing:
        return _pose(run)
    kept = [i for i in range(len(run.shapes.names)) if i not in missing]
    if len(kept) < 2:
        raise CollectionError(
            f"{len(kept)} complete shapes: at least two are needed to pose {len(missing)} incomplete ones on"
        )
    reference = run.session.options.reference
    if reference and run.constraints.reference in missing:
        raise InputError(f"reference: {reference!r} is incomplete; choose a complete shape")
    return _pose(run.some(kept))


def _pose(run: Run) -> _Answer:
    """Pose complete shapes; the steps are those of section 6.3 of Maron et al. (2016)."""
    decided, matched = steps.match(run)
    matched = steps.prove(decided, matched)
    matched = steps.weigh(decided, matched)
    return decided, matched, steps.pose(decided, matched)


def _judged(decided: Run, matched: Matched, posed: Posed) -> Posed:
    """State confidences, settle doubts, and map all vertices, once it is known which shapes are posed together."""
    posed = steps.settle(decided, matched, steps.state_trust(decided, posed))
    return steps.with_vertices(decided, posed)
