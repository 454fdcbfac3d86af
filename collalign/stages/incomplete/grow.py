"""Aligns shapes of which none is complete, such as scans from several sides: every pair, a tree, then each on all.

Every two shapes propose poses. A spanning tree of the pairs of least energy (those that overlap most) gives a first
pose of each; then every shape in turn takes that of all its pairs' proposals which fits all others best, and is
refined on them, so that a wrong pair of the tree does not stay.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import networkx as nx
import numpy as np

from collalign.engine.store.records import Record
from collalign.products.shapes import Shapes
from collalign.products.trust import DOUBT
from collalign.stages.incomplete.add import (
    incomplete_alternatives,
    incomplete_note,
    incomplete_pairs,
    incomplete_record,
)
from collalign.stages.incomplete.place import NUM_PROPOSED, Sizes, nearest_labels, pose_chance, pose_record, settle
from collalign.stages.incomplete.posed_points import posed_points, prepare_points
from collalign.stages.pairs.choose import MAX_ALL_PAIRS
from collalign.stages.poses.placement import common_positions
from collalign.stages.steps import Posed, Run
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.surface_points import OrientedPoints
from data_tools.errors import InputError
from data_tools.poses import Similarity, scales_of
from data_tools.threads import one_blas_thread
from pairwise.partial.match import match_partial

#: How often every shape is posed on all others.
NUM_SWEEPS = 3
#: Shapes that nobody called scans are scans where half of them cover less of the others than this, and all are sure.
#: Ten scans of a bunny cover .43 to .54 of each other, cut crowns .87, doubtful whole ones .65 to .82, wrong at .99.
MOST_COVERED = 0.6
#: Why shapes count as incomplete that nobody called so.
IN_DOUBT = "most were in doubt, with open borders"


@one_blas_thread()
def match_scans(target: OrientedPoints, source: OrientedPoints, group: str, sizes: Sizes | None) -> Record:
    """Return ``transforms`` (m, 4, 4) of the source's file coordinates to the target's, and ``energies`` (m,)."""
    found = match_partial(
        posed_points(target),
        posed_points(source),
        group=group,
        scale_range=sizes,
        num_candidates=NUM_PROPOSED,
    )
    transforms = np.stack([one.pose.transform for one in found])
    return {"transforms": transforms, "energies": np.array([pose.energy for pose in found])}


def align_scans(run: Run, outline: Posed, reasons: Mapping[int, str]) -> Posed:
    """Return the poses of shapes none of which is complete.

    Parameters
    ----------
    run : Run
        Its group is decided.
    outline : Posed
        The same shapes posed as if they were complete, of which all that depends on poses is replaced.
    reasons : mapping of int to str
        Why each counts as incomplete.

    Raises
    ------
    InputError
        If there are too many shapes, or poses are fixed.
    """
    session, shapes, constraints = run.session, run.shapes, run.constraints
    num = len(shapes.names)
    if num > MAX_ALL_PAIRS or constraints.fixed:
        raise InputError(
            "incomplete: poses of shapes none of which is complete are found together, for at most "
            f"{MAX_ALL_PAIRS} shapes and without fixed poses"
        )
    sizes = None if session.options.scaling == "similarity" else (1.0, 1.0)
    with run.stage("incomplete shapes"):
        surfaces = prepare_points(session, shapes, range(num))
        tasks = {
            (i, j): {
                "target": surfaces.shared(i),
                "source": surfaces.shared(j),
                "group": session.options.group,
                "sizes": sizes,
            }
            for i, j in itertools.combinations(range(num), 2)
        }
        found = session.spread("incomplete shapes", match_scans, tasks)
        points = [surfaces[i] for i in range(num)]
        transforms, settled = _settled(points, found, constraints.reference, sizes)
    transforms = _framed(shapes, transforms, session.options.scaling, constraints.reference)
    return _collected(shapes, outline, transforms, settled, reasons)


def are_scans(posed: Posed) -> bool:
    """Whether shapes that :func:`align_scans` posed share so little, and fit so surely, that none is complete."""
    covered = float(np.median([one.coverage for one in posed.incomplete]))
    return covered < MOST_COVERED and bool((posed.solution.confidence >= DOUBT).all())


def tree_transforms(found: Mapping[tuple[int, int], Record], num: int, root: int) -> FloatArray:
    """Return poses (N, 4, 4) in the root's coordinates, along the tree of the pairs of least energy."""
    graph = nx.Graph()
    graph.add_nodes_from(range(num))
    for (i, j), record in found.items():
        graph.add_edge(i, j, weight=float(record["energies"][0]))
    transforms = np.tile(np.eye(4), (num, 1, 1))
    for parent, child in nx.bfs_edges(nx.minimum_spanning_tree(graph), root):
        transforms[child] = transforms[parent] @ _relative(found, parent, child)[0]
    return transforms


def _relative(found: Mapping[tuple[int, int], Record], target: int, source: int) -> FloatArray:
    """Return what a pair proposes, from source to target, shape (m, 4, 4)."""
    if target < source:
        return np.asarray(found[target, source]["transforms"])
    return np.asarray(np.linalg.inv(found[source, target]["transforms"]))


@one_blas_thread()
def _settled(
    points: Sequence[OrientedPoints], found: Mapping[tuple[int, int], Record], root: int, sizes: Sizes | None
) -> tuple[FloatArray, dict[int, Record]]:
    """Return poses in the root's coordinates, each the best on all others, and what is known of them."""
    num = len(points)
    transforms = tree_transforms(found, num, root)
    settled: dict[int, Record] = {}
    for sweep in range(NUM_SWEEPS):
        posed = [posed_points(points[i], transforms[i]) for i in range(num)]
        for i in range(num):
            others = [j for j in range(num) if j != i]
            proposed = [transforms[j] @ _relative(found, j, i) for j in others]
            source, targets = posed_points(points[i]), [posed[j] for j in others]
            poses = Similarity.of_transforms(transforms[i][None])
            if i != root:
                every = Similarity.of_transforms(np.concatenate([transforms[i][None], *proposed]))
                poses = settle(targets, source, every, sizes=sizes, complete=False)
            transforms[i] = poses[0].transform
            posed[i] = posed_points(points[i], transforms[i])
            if sweep == NUM_SWEEPS - 1:
                settled[i] = pose_record(targets, source, poses, complete=False)
    return transforms, settled


def _framed(shapes: Shapes, transforms: FloatArray, scaling: str, root: int) -> FloatArray:
    """Return the poses with all samples centred, and of the root's normalised size unless sizes stay."""
    framed = transforms.copy()
    if scaling == "similarity":
        framed[:, :3] /= shapes.samples[root].scale
    framed[:, :3, 3] -= common_positions(shapes.samples, framed).mean(axis=(0, 1))
    return framed


def common_points(positions: FloatArray) -> FloatArray:
    """Return points that stand for all samples (N, k, 3): those farther from all before than samples lie apart."""
    every = positions.reshape(-1, 3)
    gaps = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3)
    gaps[:, np.arange(gaps.shape[1]), np.arange(gaps.shape[1])] = np.inf
    spacing, kept = float(np.median(gaps.min(axis=2))), [0]
    for n in range(1, len(every)):
        if np.linalg.norm(every[kept] - every[n], axis=1).min() > spacing:
            kept.append(n)
    return every[kept]


def _collected(
    shapes: Shapes, outline: Posed, transforms: FloatArray, settled: Mapping[int, Record], reasons: Mapping[int, str]
) -> Posed:
    """Return the outline with the new poses and all that follows from them."""
    num, scales = len(shapes.names), scales_of(transforms)
    rotations = transforms[:, :3, :3] / scales[:, None, None]
    positions = common_positions(shapes.samples, transforms)
    universe = common_points(positions)
    labels = np.stack([nearest_labels(points, universe) for points in positions])
    everyone: IntArray = np.arange(num)
    pairs = [
        pair
        for i in range(num)
        for pair in incomplete_pairs(i, settled[i], np.delete(everyone, i), rotations, labels)
        if pair.target == i
    ]
    incomplete = tuple(
        incomplete_record(i, settled[i], reasons.get(i, ""), np.delete(everyone, i)) for i in range(num)
    )
    solution = replace(
        outline.solution,
        confidence=np.array([pose_chance(settled[i]) for i in range(num)]),
        alternatives=tuple(incomplete_alternatives(settled[i], transforms[i]) for i in range(num)),
        parts=(everyone,),
        warnings=(),
    )
    return replace(
        outline,
        pairs=pairs,
        solution=solution,
        rotations=rotations,
        transforms=transforms,
        labels=labels,
        consensus=universe,
        notes=(incomplete_note(shapes.names, incomplete),),
        trust=None,
        vertices=None,
        incomplete=incomplete,
    )
