"""From shapes to poses: pose them, see what the poses say of each shape, and pose them once more without that.

Shapes of which a part is missing are placed on the others, and material that no other shape has is left out. That is
seen at poses as if all were whole; where there is such a shape it may have spoilt these. Shapes of which most are
open may be scans of one thing instead; what they share tells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from collalign.confidence.incomplete_model import chance_against
from collalign.options import AUTO, AlignOptions
from collalign.products.pair import Pair, are_weighed
from collalign.products.trust import DOUBT
from collalign.stages import steps
from collalign.stages.choose_pairs import MAX_ALL_PAIRS
from collalign.stages.extra_material import (
    Extra,
    extra_material,
    with_extra_material,
)
from collalign.stages.incomplete.add import chances_as_parts, with_incomplete
from collalign.stages.incomplete.detect import (
    FOUND,
    LIKELIER,
    MIN_COMPLETE_SHAPES,
    are_too_many,
    find_incomplete,
)
from collalign.stages.incomplete.on_model import align_on_model
from collalign.stages.incomplete.parts import align_parts
from collalign.stages.incomplete.scans import (
    MOST_SCANS,
    align_scans,
    match_badly,
    were_seen,
)
from collalign.stages.steps import Matched, Posed, Run, with_group
from data_tools.arrays import BoolArray, FloatArray, read_only
from data_tools.errors import InputError
from data_tools.poses import APART_DEG, pose_angle_deg

#: Why a confidence is limited: the shape is an image of one side.
ONE_VIEW = "one-view"
#: A shape below is likelier to be wrong than right.
AS_LIKELY = 0.5
#: Why a confidence is limited: as a part of the others, or as a whole, the shape would lie elsewhere.
OTHER_READING = "other-reading"
#: Shapes are posed as parts of each other as well where so many of them are open, and so many doubtful. Of 24 molars,
#: all open, one is.
MOSTLY_OPEN, SOME_DOUBTFUL = 0.5, 0.1
#: The surer answer counts where at most so many shapes lie elsewhere in the other. No more than the second number is
#: stated of a part that lies elsewhere as a whole.
FEW_ELSEWHERE, CONTRADICTED = 0.25, 0.9
#: Times that shapes are posed at most.
MOST_POSINGS = 3
#: A run, its shapes' pairs and their poses.
Answer: TypeAlias = tuple[Run, Matched, Posed]


def pose_all(run: Run, missing: Mapping[int, str]) -> Answer:
    """Pose all shapes.

    Parameters
    ----------
    run : Run
    missing : mapping of int to str
        Shapes that a person, or an earlier run, calls incomplete, by position, and the code of that reason.

    Returns
    -------
    run : Run
        With the shapes that the result is of: without extra material only where ``options.ignore_extra`` says so.
    matched : Matched
    posed : Posed
    """
    missing = _on_former_parts(run, missing)
    if len(missing) >= len(run.shapes.names) - 1:
        matched = steps.unmatched(run)
        scans = _posed_scans(with_group(run, matched.group), (), missing)
        assert scans is not None  # which is for shapes that nobody called so
        return run, matched, scans
    known = None
    if not missing and _may_be_scans(run):
        known, found = _as_scans(run)
        if found is not None:
            return _surest(run, found)
    answer = _pose_in_rounds(run, missing, known)
    return answer if missing else _surest(run, answer)


def _on_former_parts(run: Run, missing: Mapping[int, str]) -> Mapping[int, str]:
    """Return what is missing; where an earlier run found few complete, new shapes are parts of those that stay."""
    fixed = run.constraints.fixed.keys()
    num_complete = len(fixed - missing.keys())
    if {*missing.values()} != {FOUND} or len(fixed) < 2 or num_complete >= MIN_COMPLETE_SHAPES:
        return missing
    return {i: LIKELIER for i in range(len(run.shapes.names)) if i not in fixed}


def _may_be_scans(run: Run) -> bool:
    """Return whether shapes may be scans of which none is complete: options allow it, and some have borders."""
    options = run.session.options
    return (
        _looks_at_shapes(options)
        and options.synchronization == "robust"
        and not options.deformable
        and not run.constraints.fixed
        and 3 <= len(run.shapes.names) <= MOST_SCANS
        and any(item.may_be_cut for item in run.shapes.samples)
        and (not run.shapes.are_assembled or were_seen(run.shapes))
    )


def _as_scans(run: Run) -> tuple[tuple[Run, Matched] | None, Answer | None]:
    """Return the pairs of whole shapes where they were matched, and the poses of scans where shapes are scans.

    Depth images match badly as whole shapes; whether they are of one object is told by what they share.
    """
    if were_seen(run.shapes):
        unmatched = steps.unmatched(run)
        scans = _posed_scans(with_group(run, unmatched.group), (), {})
        if scans is not None:
            return None, (run, unmatched, scans)
    decided, matched = steps.match(run)
    if match_badly(run.shapes, matched.pairs):
        scans = _posed_scans(decided, matched.pairs, {})
        if scans is not None:
            return None, (run, replace(matched, notes=()), scans)  # notes are about whole shapes
    return (decided, matched), None


def _posed_scans(run: Run, pairs: Sequence[Pair], reasons: Mapping[int, str]) -> Posed | None:
    """Return the poses of scans on their model or on each other; None where nobody said so, and they are no scans."""
    on_model = align_on_model(run, pairs, reasons)
    return align_scans(run, pairs, reasons) if on_model is None else on_model


def _pose_in_rounds(
    run: Run, missing: Mapping[int, str], known: tuple[Run, Matched] | None
) -> Answer:
    """Pose shapes, and again without what turns out to be incomplete or extra; ``known`` are the pairs of all."""
    whole, extra, first = run, Extra(), None
    for rounds_left in reversed(range(MOST_POSINGS)):
        answer, known = _pose_complete(run, missing, known), None
        fresh, seem_incomplete = _found_incomplete(run, missing, answer)
        if not fresh or not rounds_left:
            answer = _with_confidences(answer, seem_incomplete)
            fresh = _likelier_as_parts(run, missing, answer) if rounds_left else {}
        if fresh:
            missing = {**missing, **fresh}
            continue
        answer = _finished(run, missing, answer)
        first = first or answer
        found = extra_material(answer, whole.shapes, extra) if _is_free(run) else extra
        if found.lacks_some_of(extra):
            return first  # it is no extra material without it
        if found.is_same(extra) or not rounds_left:
            break
        shapes = whole.read_without(found.surfaces)
        if shapes.names != whole.shapes.names:
            return first
        run, extra = replace(whole, shapes=shapes), found
    return with_extra_material(answer, whole, extra)


def _looks_at_shapes(options: AlignOptions) -> bool:
    """Return whether nobody said which shapes are incomplete."""
    return options.incomplete == AUTO


def _is_free(run: Run) -> bool:
    """Return whether shapes may be read otherwise than as they are: there are confidences, and nobody decided."""
    options = run.session.options
    return (
        _looks_at_shapes(options)
        and options.synchronization == "robust"
        and not run.constraints.fixed
    )


def _pose_complete(
    run: Run, missing: Mapping[int, str], known: tuple[Run, Matched] | None
) -> Answer:
    """Pose the shapes of which nothing is missing; section 6.3 of Maron et al. (2016)."""
    if missing:
        kept = _complete(run, missing)
        reference = run.session.options.reference
        if reference and run.constraints.reference in missing:
            raise InputError(f"reference: {reference!r} is incomplete; choose a complete shape")
        run, known = run.some(kept), None
    decided, matched = steps.match(run) if known is None else known
    matched = steps.prove(decided, matched)
    matched = steps.weigh(decided, matched)
    return decided, matched, steps.pose(decided, matched)


def _complete(run: Run, missing: Mapping[int, str]) -> list[int]:
    return [i for i in range(len(run.shapes.names)) if i not in missing]


def _found_incomplete(
    run: Run, missing: Mapping[int, str], answer: Answer
) -> tuple[dict[int, str], dict[int, str]]:
    """Return which of the posed shapes turn out to be incomplete, and why others seem to be, both by position.

    The latter is among the posed. They only seem so where too few would be left, or most are. Images of one side each
    that match badly, and could not be joined as scans, may show different sides. Shapes that bend so much that maps
    were asked tell nothing.
    """
    decided, matched, posed = answer
    if not _looks_at_shapes(run.session.options):
        return {}, {}
    kept = _complete(run, missing)
    are_views = were_seen(decided.shapes) and match_badly(decided.shapes, matched.pairs)
    views = dict.fromkeys(range(len(kept)), ONE_VIEW) if are_views else {}
    if are_weighed(matched.pairs):
        return {}, views
    with run.stage("incomplete shapes"):
        found = find_incomplete(run.session, decided.shapes, posed.pairs, posed.transforms)
    if are_too_many(len(found), len(kept)):
        return {}, views | found
    fixed = run.constraints.fixed
    return {kept[n]: reason for n, reason in found.items() if kept[n] not in fixed}, views


def _with_confidences(answer: Answer, seem_incomplete: Mapping[int, str]) -> Answer:
    """State confidences of the posed shapes."""
    decided, matched, posed = answer
    posed = steps.state_trust(decided, replace(posed, seem_incomplete=seem_incomplete))
    return decided, matched, posed


def _likelier_as_parts(run: Run, missing: Mapping[int, str], answer: Answer) -> dict[int, str]:
    """Return which doubtful shapes with open borders are posed more surely as parts of the others, by position."""
    decided, _, posed = answer
    if not _is_free(run) or were_seen(decided.shapes):
        return {}
    kept = _complete(run, missing)
    confidence = posed.confidence_but_for_sides
    doubtful = [
        n
        for n, item in enumerate(decided.shapes.samples)
        if confidence[n] < AS_LIKELY and item.may_be_cut and kept[n] not in run.constraints.fixed
    ]
    if not doubtful or 2 * len(doubtful) >= len(kept):
        return {}
    with run.stage("incomplete shapes"):
        chances = chances_as_parts(decided, posed, doubtful)
    return {kept[n]: LIKELIER for n in doubtful if chances[n] > confidence[n]}


def _finished(run: Run, missing: Mapping[int, str], answer: Answer) -> Answer:
    """Reconsider doubtful shapes, map all vertices, and place the incomplete shapes."""
    decided, matched, posed = answer
    posed = steps.with_vertices(decided, steps.reconsider_doubtful(decided, matched, posed))
    if missing:
        posed = with_incomplete(with_group(run, matched.group), posed, missing)
    return run, matched, posed


def _surest(run: Run, answer: Answer) -> Answer:
    """Return the answer, or that of all shapes as parts of each other, if most are open and some doubtful.

    That in parts is taken if it is surer, or the two contradict each other: of shapes all of which were cut, whole
    ones were right less often. What the other answer contradicts is less sure.
    """
    _, matched, posed = answer
    options = run.session.options
    doubtful = posed.confidence_but_for_sides < DOUBT
    opened = np.array([item.rim == "open" for item in run.shapes.samples])
    if (
        not _is_free(run)
        or options.deformable
        or options.certify
        or posed.extra
        or run.shapes.are_assembled
        or were_seen(run.shapes)
        or not 3 <= len(opened) <= MAX_ALL_PAIRS
        or opened.mean() < MOSTLY_OPEN
        or doubtful.mean() < SOME_DOUBTFUL
    ):
        return answer
    parts = align_parts(with_group(run, matched.group), matched.pairs, posed.side_chances)
    if parts is None:
        return answer
    return answer[0], matched, _surer(posed, parts)


def _surer(whole: Posed, parts: Posed) -> Posed:
    """Return the poses of shapes as wholes, or as parts of each other, less sure where the others contradict them."""
    whole_sure, part_sure = whole.solution.confidence, parts.solution.confidence
    elsewhere = _lie_elsewhere(whole, parts)
    if part_sure.mean() > whole_sure.mean() or elsewhere.mean() > FEW_ELSEWHERE:
        return _less_sure(
            parts, np.where(elsewhere, np.minimum(part_sure, CONTRADICTED), part_sure)
        )
    return _less_sure(whole, np.where(elsewhere, chance_against(whole_sure, part_sure), whole_sure))


def _lie_elsewhere(posed: Posed, other: Posed) -> BoolArray:
    """Return which shapes lie elsewhere in the other answer, in the frame of most, shape (N,)."""
    turns = posed.rotations @ np.swapaxes(other.rotations, 1, 2)
    agree = pose_angle_deg(turns[:, None], turns) <= APART_DEG
    return np.asarray(~agree[np.argmax(agree @ posed.solution.confidence)])


def _less_sure(posed: Posed, most: FloatArray) -> Posed:
    """Return poses of other confidences (N,); the other answer limits those that are less than before."""
    is_less = most < posed.solution.confidence
    before = posed.limited_by or ("",) * len(most)
    return replace(
        posed,
        solution=replace(posed.solution, confidence=read_only(most)),
        limited_by=tuple(
            OTHER_READING if less else code for less, code in zip(is_less, before, strict=True)
        ),
    )
