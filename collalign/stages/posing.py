"""Which shapes of a run are posed on each other, which on the others: complete ones, incomplete ones, scans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

from collalign.options import AUTO, MAX_ROUNDS, AlignOptions
from collalign.products.pair import are_weighed
from collalign.stages import steps
from collalign.stages.choose_pairs import MAX_ALL_PAIRS
from collalign.stages.incomplete.add import with_incomplete
from collalign.stages.incomplete.detect import (
    MIN_SHAPES,
    OPEN,
    find_incomplete,
    found_complete,
    match_like_copies,
    may_be_broken,
)
from collalign.stages.incomplete.scans import align_scans, match_badly, were_seen
from collalign.stages.steps import Matched, Posed, Run, with_group
from data_tools.errors import CollectionError, InputError

#: The run of the shapes that are posed, its group decided; their pairs; their poses.
_Answer: TypeAlias = tuple[Run, Matched, Posed]


def looks_for_incomplete(options: AlignOptions) -> bool:
    """Return whether nobody said which shapes are incomplete."""
    return options.incomplete == AUTO


def pose_all(run: Run, missing: Mapping[int, str]) -> tuple[Matched, Posed]:
    """Pose all shapes; ``missing`` says why some are incomplete: they were called so, or their surface is open."""
    all_named = len(missing) == len(run.shapes.names)
    tries_scans = _tries_scans(run, missing)
    if tries_scans and were_seen(run.shapes):
        # Depth images match badly as whole shapes, and what they share tells whether they are of one object.
        unmatched = steps.unmatched(run)
        scans = align_scans(with_group(run, unmatched.group), (), {})
        if scans is not None:
            return unmatched, scans
    known = steps.match(run) if all_named or tries_scans else None
    is_bad = known is not None and match_badly(run.shapes, known[1].pairs)
    if known and (all_named or is_bad):
        decided, matched = known
        scans = align_scans(decided, matched.pairs, missing if all_named else {})
        if scans is not None:
            return replace(matched, notes=()), scans  # which are about whole shapes
    if OPEN in missing.values():
        return _pose_few_open(run, missing)
    return _pose_on_complete(run, missing, known, in_doubt=is_bad)


def _pose_few_open(run: Run, missing: Mapping[int, str]) -> tuple[Matched, Posed]:
    """Pose shapes a few of which are open: those that match like copies, or turn out to be complete, are complete."""
    known = steps.match(run)
    alike = match_like_copies(known[1].pairs)
    missing = {i: why for i, why in missing.items() if why != OPEN or i not in alike}
    matched, posed = _pose_on_complete(run, missing, None if missing else known)
    whole = found_complete(posed.incomplete)
    if whole:
        matched, posed = _pose_on_complete(
            run, {i: why for i, why in missing.items() if i not in whole}
        )
    return matched, posed


def _tries_scans(run: Run, missing: Mapping[int, str]) -> bool:
    """Return whether shapes may be scans of which none is complete: nobody said otherwise, and options allow it."""
    options = run.session.options
    return (
        not missing
        and looks_for_incomplete(options)
        and options.synchronization == "robust"
        and not options.deformable
        and not run.constraints.fixed
        and 3 <= len(run.shapes.names) <= MAX_ALL_PAIRS
        and any(item.rim != "closed" for item in run.shapes.samples)
        and (may_be_broken(options, run.shapes) or were_seen(run.shapes))
    )


def _pose_on_complete(
    run: Run,
    missing: Mapping[int, str],
    known: tuple[Run, Matched] | None = None,
    *,
    in_doubt: bool = False,
) -> tuple[Matched, Posed]:
    """Pose complete shapes and judge that, then the others on them.

    ``known`` are the pairs of all where matched. Shapes are ``in_doubt`` if they match so badly as whole shapes that
    hardly any can be complete; where maps are asked, they bend.
    """
    decided, matched, posed = _pose_others(run, missing) if known is None else _pose(run, known)
    if {*missing.values()} <= {OPEN} and looks_for_incomplete(run.session.options):
        missing, (decided, matched, posed) = _without_found(run, missing, (decided, matched, posed))
    if in_doubt and not are_weighed(matched.pairs):
        posed = replace(posed, suspects=frozenset(range(len(posed.rotations))))
    posed = _with_confidences(decided, matched, posed)
    if missing:
        posed = with_incomplete(with_group(run, matched.group), posed, missing)
    return matched, posed


def _without_found(
    run: Run, missing: Mapping[int, str], answer: _Answer
) -> tuple[dict[int, str], _Answer]:
    """Return the shapes that turn out to be incomplete, and the others posed without them; in rounds.

    Incomplete shapes among complete ones may spoil poses, and so hide others. Where too few would be left, they stay,
    in doubt. Shapes that bend so much that maps were asked tell nothing.
    """
    missing = dict(missing)
    for _ in range(0 if are_weighed(answer[1].pairs) else MAX_ROUNDS):
        posed = answer[2]
        kept = [i for i in range(len(run.shapes.names)) if i not in missing]
        with run.stage("incomplete shapes"):
            found = find_incomplete(
                run.session, run.shapes.some(kept), posed.pairs, posed.transforms
            )
        fresh = {
            kept[n]: reason for n, reason in found.items() if kept[n] not in run.constraints.fixed
        }
        if not fresh:
            break
        if len(kept) - len(fresh) < MIN_SHAPES:
            suspects = frozenset(kept.index(i) for i in fresh)
            answer = (*answer[:2], replace(posed, suspects=suspects))
            break
        missing |= fresh
        answer = _pose_others(run, missing)
    return missing, answer


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


def _pose(run: Run, known: tuple[Run, Matched] | None = None) -> _Answer:
    """Pose complete shapes, from their pairs if these are known; section 6.3 of Maron et al. (2016)."""
    decided, matched = steps.match(run) if known is None else known
    matched = steps.prove(decided, matched)
    matched = steps.weigh(decided, matched)
    return decided, matched, steps.pose(decided, matched)


def _with_confidences(decided: Run, matched: Matched, posed: Posed) -> Posed:
    """State confidences, reconsider doubtful shapes, and map all vertices, once posed together."""
    posed = steps.reconsider_doubtful(decided, matched, steps.state_trust(decided, posed))
    return steps.with_vertices(decided, posed)
