"""Aligns each kind of shapes by itself, and the frames of the kinds to each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.driver.join_kinds import join_kinds, kind_notes
from collalign.driver.made import record_of_run
from collalign.driver.one_kind import KindTask, align_one
from collalign.output.collection import Collection
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.run_record import Made
from collalign.products.shapes import Shapes
from collalign.stages import steps
from collalign.stages.kinds.kind_frames import kind_frames, lone_transform
from collalign.stages.kinds.plan import (
    KindPlan,
    distinct_called,
    settled_kinds,
)
from collalign.stages.poses.placement import common_positions
from collalign.stages.steps import with_decided_group
from data_tools.arrays import IntArray, read_only
from data_tools.errors import CollectionError
from data_tools.io.source import location
from data_tools.poses import each_moved_by


def align_kinds(task: KindTask, plan: KindPlan, *, are_given: bool) -> Collection:
    """Align each kind of shapes by itself, and each that shares a frame with another to this one."""
    names, whole = plan.shapes.names, task.listing.names
    at = {name: i for i, name in enumerate(whole)}
    reference = task.session.options.reference or next(iter(task.own.marks), names[0])
    root = plan.kind_of(reference)
    tasks = {
        kind: task.some([at[names[i]] for i in members.tolist()], has_reference=kind == root)
        for kind, members in enumerate(plan.members)
    }
    found = list[Collection]()
    called, confidence, members = list[str](), list[float](), list[IntArray]()
    for kind, own in tasks.items():
        parts = [own]
        if len(own.listing.names) > 1:
            try:
                found.append(align_one(own))
            except CollectionError:
                if task.session.options.strict:
                    raise
                parts = [own.some([i], has_reference=False) for i in range(len(own.listing.names))]
            else:
                parts = []
        found += [lone_result(one, plan.shapes) for one in parts]
        num = max(len(parts), 1)
        called += [plan.names[kind]] * num
        confidence += [plan.confidence[kind]] * num
    position = {name: i for i, name in enumerate(names)}
    members = [np.array([position[name] for name in one.names]) for one in found]
    rotations = np.tile(np.eye(3), (len(names), 1, 1))
    for one, own_members in zip(found, members, strict=True):
        rotations[own_members] = one.rotations
    of_reference = next(k for k, one in enumerate(found) if reference in one.names)
    with steps.timed(task.session, {}, "kinds"):
        frames = kind_frames(
            with_decided_group(task.session, "SO"),
            plan.shapes,
            members,
            rotations,
            plan.log_odds,
            root=of_reference,
            settled=settled_kinds(
                task.former, [one.names for one in found], {*task.kept, *task.fixed}
            ),
        )
    result = join_kinds(names, found, frames, distinct_called(called), confidence)
    asked = task.session.options
    named = [direction for direction in ("up", "front") if getattr(asked, direction)]
    said = kind_notes(result.kinds, result.names, are_given=are_given, named=named)
    return replace(
        result,
        notes=(*said, *result.notes),
        options=replace(asked, cleaning=found[of_reference].options.cleaning),
    )


def lone_result(task: KindTask, shapes: Shapes) -> Collection:
    """Return the result of one shape that has no other of its kind: as in its file, in the middle and at one size."""
    (name,), options = task.listing.names, task.session.options
    at = shapes.names.index(name)
    sample = shapes.samples[at]
    labels = np.arange(len(sample.positions))[None]
    pose = task.kept.get(name, task.fixed.get(name, np.eye(3)))
    transforms = lone_transform(sample, np.asarray(pose, dtype=np.float64), options.scaling)[None]
    positions = common_positions([sample], transforms)
    in_file = each_moved_by(np.asarray(np.linalg.inv(transforms), dtype=np.float64), positions)
    return Collection(
        names=(name,),
        files=(location(shapes.files[at]),),
        digests=(shapes.digests[at],),
        transforms=read_only(transforms),
        confidence=read_only(np.full(1, np.nan)),
        samples=read_only(sample.vertex_indices[None]),
        positions=read_only(positions),
        maps=ConsistentMaps(names=(name,), labels=read_only(labels)),
        consensus=read_only(positions[0]),
        landmarks=read_only(in_file),
        pairs=(),
        alternatives=((),),
        part_numbers=read_only(np.zeros(1, dtype=np.int64)),
        by_hand={name: float("nan")} if name in task.fixed else {},
        options=options,
        group="SO",
        run=record_of_run({}, 0, ()),
        cycle_errors_deg=read_only(np.zeros(0)),
        fresh=Made(
            files=(shapes.files[at],),
            coordinates=read_only(sample.coordinates[None]),
            invariants=read_only(sample.invariants[None]),
            shape_notes=(sample.notes,),
        ),
    )
