"""Poses scans on the one complete shape of a collection, their model: all of a scan lies on it.

Each scan is placed by itself. What it shares with other scans, and what these saw, is not looked at: a scan may show
any part of its model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from collalign.confidence.overlap_model import MOST_CERTAIN, chances_of, on_whole_log_odds
from collalign.engine.job import Job, Results, Wanted
from collalign.options import AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes, free_rotation
from collalign.products.trust import DOUBT
from collalign.stages.incomplete.join import CONSISTENT_CELLS, JoinedScans, WeakCut
from collalign.stages.incomplete.scan_pairs import (
    NUM_CANDIDATES,
    common_cell,
    describe_surfaces,
    side_known,
)
from collalign.stages.incomplete.scans import SCAN, posed_scans
from collalign.stages.steps import Posed, Run
from data_tools.arrays import BoolArray, FloatArray
from data_tools.local_surface import LocalSurface
from data_tools.poses import AGREE_DEG, Similarity
from pairwise.features.on_whole import MOST_LARGER, TwoScales, free_axis, match_on_whole
from pairwise.features.overlap import LocalPoses

#: A closed mesh is a model of scans if they lie on it with at least this mean probability. Generated models of ten
#: kinds have .42 and more, of two others .22 and .29, and models of other kinds .03 at most.
LEAST_PLACED = 0.4


def align_on_model(run: Run, pairs: Sequence[Pair], reasons: Mapping[int, str]) -> Posed | None:
    """Return the poses of scans on their model; None where there is none, or shapes are hardly scans of it.

    Sizes are those of the files. The model is the shape that nobody called incomplete, or the only closed mesh.

    Parameters
    ----------
    run : Run
        Its group is decided.
    pairs : sequence of Pair
        The shapes as if they were complete, if they were matched.
    reasons : mapping of int to str
        Why each counts as incomplete; empty where nobody said so. The mean probability of poses must be .4 then.
    """
    shapes, num = run.shapes, len(run.shapes.names)
    complete = [i for i, item in enumerate(shapes.samples) if item.rim == "closed"]
    if reasons:
        complete = [i for i in range(num) if i not in reasons]
    if len(complete) != 1 or run.constraints.fixed:
        return None
    with run.stage("incomplete shapes"):
        placed, axes = place_on_model(run.session, shapes, complete[0])
    scans = [i for i in range(num) if i != complete[0]]
    if not reasons and placed.confidence[scans].mean() < LEAST_PLACED:
        return None
    posed = posed_scans(run, pairs, placed, reasons or dict.fromkeys(scans, SCAN))
    names = shapes.names
    free = (
        free_rotation(names[i], names[complete[0]], axis)
        for i, axis in axes.items()
        if placed.confidence[i] >= DOUBT
    )
    return replace(posed, notes=(*posed.notes, *free))


def place_on_model(
    session: AlignSession, shapes: Shapes, model: int
) -> tuple[JoinedScans, dict[int, FloatArray]]:
    """Return each scan at its likeliest pose on the model, how probable that is, and the axes of those that turn.

    Axes (2, 3) are points and directions in coordinates of the model, by positions of scans; few have one.
    """
    coarse, found = _poses_on_model(session, shapes, model)
    axes: dict[int, FloatArray] = {}
    transforms, confidence = (
        np.tile(np.eye(4), (len(shapes.names), 1, 1)),
        np.zeros(len(shapes.names)),
    )
    chances, overlaps, kept, cuts = {}, {}, {}, []
    for i, unordered in found.items():
        own = chances_of(on_whole_log_odds(unordered))
        order = np.argsort(-own, kind="stable")
        own, poses = own[order], unordered[order]
        placed = Similarity.rigid(poses.rotations, poses.shifts).transform
        same = np.arange(len(poses)) == 0
        whole, is_known = coarse[model], side_known(shapes, i)
        if (axis := _free_axis(whole, coarse[i], poses, side_known=is_known)) is not None:
            axes[i] = axis
            same |= _turned_about(axis, placed, whole.cell)
        transforms[i], confidence[i] = placed[0], min(float(own[same].sum()), MOST_CERTAIN)
        ends = min(i, model), max(i, model)
        chances[ends], overlaps[ends] = own, poses if model < i else poses.inverse()
        kept[ends] = overlaps[ends][:1]
        cuts += [
            WeakCut(
                ends=ends,
                members=np.array([i]),
                held=-float(np.log1p(-confidence[i])),
                against=-float(np.log1p(-own[n])),
                move=placed[n] @ np.linalg.inv(placed[0]),
            )
            for n in np.flatnonzero(~same).tolist()
        ]
    confidence[model] = confidence.max()
    lost = [i for i in range(len(shapes.names)) if i != model and i not in found]
    joined = JoinedScans(
        transforms=transforms,
        confidence=confidence,
        chances=chances,
        overlaps=overlaps,
        kept=kept,
        parts=[np.array(sorted({model, *found})), *(np.array([i]) for i in lost)],
        cuts=cuts,
    )
    return joined, axes


def _free_axis(
    whole: LocalSurface, scan: LocalSurface, poses: LocalPoses, *, side_known: bool
) -> FloatArray | None:
    """Return the axis (2, 3) about which a scan turns freely on its model at the first pose."""
    rotation, shift = poses.rotations[0], poses.shifts[0]
    if np.linalg.det(rotation) < 0:
        return None
    return free_axis(whole, scan, rotation, shift, side_known=side_known)


def _turned_about(axis: FloatArray, placed: FloatArray, cell: float) -> BoolArray:
    """Return which poses (p, 4, 4) are the first one turned about an axis (2, 3), shape (p,)."""
    moves = placed @ np.linalg.inv(placed[0])
    keeps = moves[:, :3, :3] @ axis[1] @ axis[1] >= np.cos(np.radians(AGREE_DEG))
    slides = moves[:, :3, :3] @ axis[0] + moves[:, :3, 3] - axis[0]
    is_near = np.linalg.norm(slides, axis=1) < CONSISTENT_CELLS * cell
    return np.asarray(keeps & is_near & (np.linalg.det(moves[:, :3, :3]) > 0))


def _poses_on_model(
    session: AlignSession, shapes: Shapes, model: int
) -> tuple[Results[int, LocalSurface], dict[int, LocalPoses]]:
    """Return the surfaces, and the poses of scans on their model, by position.

    There are no poses of scans of another unit or of too few points.
    """
    samples, group = shapes.samples, session.options.group
    cell = common_cell([samples[model]])
    chosen = [i for i, item in enumerate(samples) if common_cell([item]) <= MOST_LARGER * cell]
    coarse, fine = (
        describe_surfaces(session, shapes, chosen, size, of_scene=False)
        for size in (cell, 0.5 * cell)
    )
    described = sorted({*coarse} & {*fine})
    wanted = {}
    for i in described if model in described else ():
        if i == model:
            continue
        ends = {
            "whole": coarse.shared(model),
            "fine_whole": fine.shared(model),
            "part": coarse.shared(i),
            "fine_part": fine.shared(i),
        }
        asked = {"group": group, "side_known": side_known(shapes, i)}
        wanted[i] = Wanted(
            key=PLACING.key(asked, *(end.key for end in ends.values())),
            label=shapes.label(model, i),
            arguments={**ends, **asked},
        )
    found = session.compute(PLACING, wanted, time_limit_s=session.run.pair_time_limit_s)
    return coarse, {i: poses for i, poses in found.items() if len(poses)}


def place_scan(
    whole: LocalSurface,
    fine_whole: LocalSurface,
    part: LocalSurface,
    fine_part: LocalSurface,
    group: str,
    side_known: bool,
) -> LocalPoses:
    """Return the poses at which all of a scan lies on its model; runs inside a worker."""
    both = TwoScales(whole, fine_whole), TwoScales(part, fine_part)
    return match_on_whole(*both, group=group, num_candidates=NUM_CANDIDATES, side_known=side_known)


#: Places a scan on its model. The version changes whenever the same surfaces would give other poses.
PLACING = Job(kind="evidence", version="on-model-3", run=place_scan, reader=LocalPoses)
