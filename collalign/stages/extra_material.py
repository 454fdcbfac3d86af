"""Poses shapes without their extra material, such as a stand, which centroid, size and invariants would be off by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from collalign.matching_input import match_at_rotation
from collalign.options import MAX_ROUNDS
from collalign.products.pair import AlignedPair
from collalign.products.shapes import ExtraMaterial, Shapes
from collalign.stages.extra_points import TUNED, find_extra
from collalign.stages.incomplete.add import label_map
from collalign.stages.incomplete.place import nearest_labels
from collalign.stages.poses.agreement import with_common_match
from collalign.stages.poses.placement import (
    common_positions,
    in_label_order,
    labels_at_common_poses,
)
from collalign.stages.posing import looks_for_incomplete, pose_all
from collalign.stages.steps import Matched, Posed, Run
from data_tools.arrays import read_only
from data_tools.notes import Note
from data_tools.surface.extra import ExtraSurface

#: Extra material by name, and the run, pairs and poses without it.
_Found: TypeAlias = Mapping[str, ExtraSurface]
_Answer: TypeAlias = tuple[Run, Matched, Posed]


def pose_without_extra(
    run: Run, missing: Mapping[int, str], prepare: Callable[[_Found], Shapes]
) -> _Answer:
    """Pose all shapes, those with extra material without it; in rounds, since it may spoil the first poses.

    Parameters
    ----------
    run : Run
    missing : mapping of int to str
        Why some shapes are incomplete.
    prepare : callable
        Returns the shapes without the extra material of some, by name.

    Returns
    -------
    run : Run
        With the samples of whole surfaces, unless ``options.ignore_extra`` leaves the extra material out of these.
    matched : Matched
    posed : Posed
    """
    whole, first = run.shapes, (run, *pose_all(run, missing))
    if not _looks_for_extra(run):
        return first
    answer, extra = first, _found_at(first, whole, TUNED.lacking_at_first)
    for _ in range(MAX_ROUNDS):
        shapes = prepare(extra) if extra else whole
        if not extra or shapes.names != whole.names:
            return first
        cut = replace(run, shapes=shapes)
        answer, before = (cut, *pose_all(cut, missing)), extra
        extra = _found_at(answer, whole, TUNED.lacking)
        if _are_same(extra, before):
            break
    if before.keys() - extra.keys():
        return first
    (cut, matched, posed), extra = answer, before
    ignored = run.session.options.ignore_extra
    if not ignored:
        cut, posed = run, _with_whole_samples(posed, whole, extra)
    of_shapes = tuple(
        ExtraMaterial(shape=i, surface=extra[name])
        for i, name in enumerate(whole.names)
        if name in extra
    )
    note = Note(
        "extra-material",
        tuple(whole.names[one.shape] for one in of_shapes),
        {
            "shares": tuple(one.share for one in of_shapes),
            "sides": tuple(one.side(posed.transforms[one.shape]) for one in of_shapes),
            "ignored": ignored,
        },
    )
    return cut, matched, replace(posed, extra=of_shapes, notes=(*posed.notes, note))


def _looks_for_extra(run: Run) -> bool:
    """Return whether all shapes are of one kind, with confidences, and nobody decided about poses."""
    options = run.session.options
    return (
        looks_for_incomplete(options)
        and options.synchronization == "robust"
        and not run.constraints.fixed
    )


def _found_at(answer: _Answer, whole: Shapes, most_lacking: float) -> dict[str, ExtraSurface]:
    """Return the extra material of whole shapes at the poses of an answer; none where most of these are in doubt."""
    run, _, posed = answer
    if np.median(posed.solution.confidence) <= TUNED.doubtful:
        return {}
    lacking = {one.shape for one in posed.incomplete}
    part = [i for i in max(posed.solution.parts, key=len).tolist() if i not in lacking]
    with run.stage("extra material"):
        found = find_extra(run.session, whole.samples, posed.transforms, part, most_lacking)
    return {whole.names[i]: surface for i, surface in found.items()}


def _are_same(found: _Found, before: _Found) -> bool:
    """Return whether the same surface is extra as before."""
    return found.keys() == before.keys() and all(
        (one.is_extra & before[name].is_extra).sum()
        >= TUNED.same_share * (one.is_extra | before[name].is_extra).sum()
        for name, one in found.items()
    )


def _with_whole_samples(posed: Posed, whole: Shapes, extra: _Found) -> Posed:
    """Return poses that stay, with maps and labels of the samples of whole surfaces."""
    samples, rotations = whole.samples, posed.rotations
    changed = {i for i, name in enumerate(whole.names) if name in extra}

    def of_whole(pair: AlignedPair) -> AlignedPair:
        if not {pair.target, pair.source} & changed:
            return pair
        ends = samples[pair.target], samples[pair.source]
        maps = [match_at_rotation(*ends, pose[:3, :3])[0] for pose in pair.rotations]
        return replace(pair, maps=read_only(np.stack(maps)))

    num = len(posed.solution.edge_choice)
    pairs = with_common_match(
        samples, [of_whole(pair) for pair in posed.pairs[:num]], posed.solution, rotations
    )
    lacking = {one.shape for one in posed.incomplete}
    kept = np.array([i for i in range(len(samples)) if i not in lacking])
    at = {int(i): n for n, i in enumerate(kept)}
    positions, labels = common_positions(samples, posed.transforms), posed.labels.copy()
    labels[kept] = labels_at_common_poses(
        [samples[i] for i in kept],
        [replace(pair, target=at[pair.target], source=at[pair.source]) for pair in pairs],
        rotations[kept],
    )
    consensus = in_label_order(positions[kept], labels[kept]).mean(axis=0)
    for i in sorted(lacking):
        labels[i] = nearest_labels(positions[i], consensus)
    of_lacking = [
        replace(
            pair,
            map_target_source=read_only(label_map(labels[pair.target], labels[pair.source])),
        )
        for pair in posed.pairs[num:]
    ]
    return replace(posed, pairs=[*pairs, *of_lacking], labels=labels, consensus=consensus)
