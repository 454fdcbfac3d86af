"""Aligns shapes any of which may be a part of the others, of unknown size: each on all others, in rounds.

Where much of most shapes is missing, there are no complete ones to pose them on. Every pair is matched in part, which
is right for more than half of such pairs, and has the right pose among its candidates for nearly all. Synchronization
makes first poses of them. Then each shape is placed on the others anew, at whatever pose a pair of it proposes. What
is common to several partners decides, which no pair can tell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from collalign.engine.job import Job, Results, Wanted
from collalign.engine.records import Record
from collalign.options import AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.incomplete.add import (
    MAX_COMPLETE_PARTNERS,
    aligned_pair,
    incomplete_alternatives,
    incomplete_note,
    incomplete_record,
    lies_elsewhere,
)
from collalign.stages.incomplete.detect import LIKELIER
from collalign.stages.incomplete.place import place_again, pose_chance
from collalign.stages.incomplete.posed_points import prepare_points
from collalign.stages.incomplete.scans import framed_poses, universe_labels
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.stages.steps import Posed, Run
from collalign.stages.trust.assess import times_side_chances
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray, Holds, IntArray, read_only
from data_tools.partial_surface import PartialSurface
from data_tools.poses import AGREE_DEG, Similarity, pose_angle_deg
from pairwise.partial_match import match_partial

#: Rounds at most, of which the one counts in which the shapes are surest. Scans of half an object took four.
MOST_ROUNDS = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class PartPoses:
    """Poses of a source on a target that it overlaps in part, the least energy first.

    Attributes
    ----------
    rotations : ndarray, shape (p, 3, 3)
        ``R_target_source``, orthogonal.
    scales : ndarray, shape (p,)
    shifts : ndarray, shape (p, 3)
        ``x -> scale rotation x + shift`` takes the source to the target.
    energies : ndarray, shape (p,)
        See :class:`pairwise.partial_match.SearchedPose`.
    """

    rotations: Annotated[FloatArray, Holds(shape="p 3 3", rotations=True)]
    scales: Annotated[FloatArray, Holds(shape="p", lower=0.0)]
    shifts: Annotated[FloatArray, Holds(shape="p 3")]
    energies: Annotated[FloatArray, Holds(shape="p", lower=0.0)]

    @property
    def poses(self) -> Similarity:
        """The poses themselves."""
        return Similarity(rotation=self.rotations, scale=self.scales, shift=self.shifts)


def match_parts(
    target: PartialSurface, source: PartialSurface, group: str, *, estimate_scale: bool
) -> PartPoses:
    """Return the poses on which two surfaces overlap in part; runs inside a worker."""
    found = match_partial(
        target, source, group=group, scale_range=None if estimate_scale else (1.0, 1.0)
    )
    return PartPoses(
        rotations=read_only(np.array([one.pose.rotation for one in found]).reshape(-1, 3, 3)),
        scales=read_only(np.array([float(one.pose.scale) for one in found])),
        shifts=read_only(np.array([one.pose.shift for one in found]).reshape(-1, 3)),
        energies=read_only(np.array([one.energy for one in found])),
    )


#: Matches a pair in part. The version changes whenever the same surfaces would give other poses.
MATCHING_PARTS = Job(kind="evidence", version="parts-3", run=match_parts, reader=PartPoses)


def align_parts(
    run: Run, matched: Sequence[Pair], side_chances: Mapping[int, float]
) -> Posed | None:
    """Return the poses of shapes that are all posed as parts of each other; None where pairs do not connect them.

    Parameters
    ----------
    run : Run
        Its group is decided.
    matched : sequence of Pair
        The shapes as if they were complete.
    side_chances : mapping of int to float
        The chances that the side of a shape is right, where that is in doubt.
    """
    session, shapes, num = run.session, run.shapes, len(run.shapes.names)
    with run.stage("incomplete shapes"):
        surfaces = prepare_points(session, shapes, range(num))
        pairs = match_pairs_in_part(
            session, shapes, surfaces, itertools.combinations(range(num), 2)
        )
        solution = synchronize_pairs(
            session.options, num, [_pair(ends, found) for ends, found in pairs.items()]
        )
        if len(solution.components) > 1:
            return None
        first = _first_transforms(pairs, solution)
        transforms, found = _in_rounds(run, surfaces, pairs, first)
    return _posed(run, matched, pairs, transforms, found, side_chances)


def match_pairs_in_part(
    session: AlignSession,
    shapes: Shapes,
    surfaces: Results[int, PartialSurface],
    edges: Iterable[tuple[int, int]],
) -> dict[tuple[int, int], PartPoses]:
    """Return the poses of those pairs that overlap in part, by target and source; the session's group is decided."""
    options, wanted = session.options, {}
    given = {"group": options.group, "estimate_scale": options.scaling == "similarity"}
    for i, j in edges:
        ends = surfaces.shared(i), surfaces.shared(j)
        wanted[i, j] = Wanted(
            key=MATCHING_PARTS.key(given, *(end.key for end in ends)),
            label=shapes.label(i, j),
            arguments={"target": ends[0], "source": ends[1], **given},
        )
    found = session.compute(MATCHING_PARTS, wanted, time_limit_s=session.run.pair_time_limit_s)
    return {ends: poses for ends, poses in found.items() if len(poses.energies)}


def _pair(ends: tuple[int, int], found: PartPoses) -> Pair:
    """Return a pair as synchronization takes it."""
    return Pair(
        target=ends[0],
        source=ends[1],
        rotations=found.rotations,
        maps=read_only(np.full((len(found.energies), 0), -1)),
        energies=found.energies,
        how="part",
    )


def _first_transforms(
    pairs: Mapping[tuple[int, int], PartPoses], solution: SynchronizationResult
) -> FloatArray:
    """Return transforms (N, 4, 4) to a common frame: sizes and places as agreeing pairs have them, on average."""
    num, rows, sizes, places = len(solution.rotations), [], [], []
    agreeing = [
        (ends, found.poses[int(choice)])
        for (ends, found), choice, agrees in zip(
            pairs.items(), solution.edge_choice, solution.edge_inlier, strict=True
        )
        if agrees
    ]
    for (i, j), pose in agreeing:
        row = np.zeros(num)
        row[[i, j]] = -1.0, 1.0
        rows.append(row)
        sizes.append(np.log(pose.scale))
    differences = np.array([*rows, np.ones(num)])
    scales = np.exp(np.linalg.lstsq(differences, np.array([*sizes, 0.0]))[0])
    for (i, _), pose in agreeing:
        places.append(scales[i] * solution.rotations[i] @ pose.shift)
    shifts = np.linalg.lstsq(differences, np.array([*places, np.zeros(3)]))[0]
    return Similarity(rotation=solution.rotations, scale=scales, shift=shifts).transform


def _in_rounds(
    run: Run,
    surfaces: Results[int, PartialSurface],
    pairs: Mapping[tuple[int, int], PartPoses],
    transforms: FloatArray,
) -> tuple[FloatArray, dict[int, Record]]:
    """Place every shape on its partners until none moves; return transforms and records of the surest round."""
    partners = _partners(pairs, run.shapes)
    best, found, surest = transforms, dict[int, Record](), -1.0
    for _ in range(MOST_ROUNDS):
        tasks = {
            i: {
                "source": surfaces.shared(i),
                "partners": tuple(surfaces.shared(j) for j in own.tolist()),
                "transforms": transforms[own],
                "proposed": _proposed(i, pairs, transforms),
                "estimate_scale": run.session.options.scaling == "similarity",
            }
            for i, own in enumerate(partners)
        }
        records = run.session.map_parallel("incomplete shapes", place_again, tasks)
        former = transforms
        transforms = np.stack([records[i]["transforms"][0] for i in tasks])
        chance = float(np.mean([pose_chance(record) for record in records.values()]))
        if chance > surest:
            best, found, surest = transforms, records, chance
        turned, before = (Similarity.of_transforms(one).rotation for one in (transforms, former))
        if (pose_angle_deg(turned, before) <= AGREE_DEG).all():
            break
    return best, found


def _partners(pairs: Mapping[tuple[int, int], PartPoses], shapes: Shapes) -> list[IntArray]:
    """Return the shapes that each is placed on: those whose pair has least energy, ties by content."""
    energies: list[list[tuple[float, str, int]]] = [[] for _ in shapes.names]
    for (i, j), found in pairs.items():
        least = float(found.energies.min())
        energies[i].append((least, shapes.keys[j], j))
        energies[j].append((least, shapes.keys[i], i))
    return [
        np.array(sorted(j for _, _, j in sorted(own)[:MAX_COMPLETE_PARTNERS]), dtype=np.int64)
        for own in energies
    ]


def _proposed(
    i: int, pairs: Mapping[tuple[int, int], PartPoses], transforms: FloatArray
) -> FloatArray:
    """Return the pose of a shape, and those that its pairs propose where the others lie, shape (p, 4, 4)."""
    proposed = [transforms[i][None]]
    for (a, b), found in pairs.items():
        if i == b:
            proposed.append(transforms[a] @ found.poses.transform)
        elif i == a:
            proposed.append(transforms[b] @ np.linalg.inv(found.poses.transform))
    return np.concatenate(proposed)


def _posed(
    run: Run,
    matched: Sequence[Pair],
    pairs: Mapping[tuple[int, int], PartPoses],
    transforms: FloatArray,
    found: Mapping[int, Record],
    side_chances: Mapping[int, float],
) -> Posed:
    """Return what follows from the poses; all open shapes count as incomplete: none tells what the others lack."""
    shapes, partners = run.shapes, _partners(pairs, run.shapes)
    framed, rotations = framed_poses(run, transforms)
    labels, universe = universe_labels(shapes, framed)
    chances = np.array([pose_chance(found[i]) for i in range(len(partners))])
    most = np.array([chances[own].mean() for own in partners])
    strange = np.array([lies_elsewhere(found[i]) for i in range(len(partners))])
    limits = [
        "no-relative" if odd else "partners" if limit < own else ""
        for odd, limit, own in zip(strange, most, chances, strict=True)
    ]
    confidence, limited_by = times_side_chances(
        np.where(strange, 0.5, 1.0) * chances * most, limits, side_chances
    )
    aligned = [
        aligned_pair(ends, poses.rotations, poses.energies, rotations, labels)
        for ends, poses in pairs.items()
    ]
    incomplete = tuple(
        incomplete_record(i, found[i], LIKELIER, own)
        for i, own in enumerate(partners)
        if shapes.samples[i].may_be_cut
    )
    every = (np.arange(len(partners)),)
    return Posed(
        pairs=aligned,
        matched=[*matched],
        solution=SynchronizationResult(
            rotations=read_only(rotations),
            confidence=read_only(confidence),
            edge_inlier=read_only(np.array([pair.inlier for pair in aligned], dtype=np.bool_)),
            edge_choice=read_only(np.array([pair.choice for pair in aligned], dtype=np.int64)),
            parts=every,
            components=every,
            alternatives=tuple(
                incomplete_alternatives(found[i], framed[i]) for i in range(len(partners))
            ),
            warnings=(),
        ),
        rotations=rotations,
        transforms=framed,
        labels=labels,
        consensus=universe,
        notes=(incomplete_note(shapes.names, incomplete),),
        side_chances=side_chances,
        limited_by=tuple(limited_by),
        incomplete=incomplete,
    )
