"""Poses one incomplete shape on several posed ones: each proposes poses, and all together decide and refine them.

A shape that is not symmetric itself may look so where a part is missing, and a single partner may fit badly where it
differs. What is common to the partners decides: every pose that fits one of them is tried on all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import TypeAlias

import numpy as np
import scipy

from collalign.confidence.incomplete_model import KNOWN_SIZES, log_odds, share_of_best
from collalign.engine.records import Record
from collalign.stages.incomplete.posed_points import beyond_rim, part_mismatch
from data_tools.arrays import FloatArray, IntArray
from data_tools.partial_surface import PartialSurface
from data_tools.poses import Similarity, pose_angle_deg, scales_of
from data_tools.threads import one_blas_thread
from pairwise.partial_counterparts import TUNED, Counterparts, counterparts
from pairwise.partial_match import distinct_similarities, propose_poses, refine, scales_allowed

#: Partners that propose poses, and those of all poses that are refined on all partners.
NUM_PROPOSERS, NUM_REFINED = 4, 24
#: Logarithms within which a point costs more than it does usually.
EXCESS_RANGE = (-3.0, 4.0)
#: The pose that changes nothing.
_STILL = Similarity.rigid(np.eye(3)[None], np.zeros((1, 3)))
#: The least and the largest scale.
Sizes: TypeAlias = tuple[float, float]


@one_blas_thread()
def place_shape(
    source: PartialSurface,
    partners: tuple[PartialSurface, ...],
    transforms: FloatArray,
    group: str,
    estimate_scale: bool,
    fixed: FloatArray | None = None,
    fixed_transform: FloatArray | None = None,
) -> Record:
    """Return the poses of a shape on its partners, the best first; runs inside a worker.

    Transforms (n, 4, 4) take file coordinates of the partners to the common frame. A person may have decided a
    rotation, ``fixed`` (3, 3), or a whole transform (4, 4) that stays: nothing is searched then.

    Returns
    -------
    dict
        ``rotations`` (m, 3, 3) and ``transforms`` (m, 4, 4): file coordinates to the common frame; ``evidence``
        (3, m), see :func:`pose_evidence`;
        ``energies`` (m, n) with each partner; ``overlaps`` (n, 2) and ``beyond``, see
        :class:`collalign.products.shapes.Incomplete`; ``on_rim``, the share of the shape's points that lie on its
        rim; ``mismatch`` of :func:`part_mismatch`; ``likeness``, the share of the shape with a counterpart, relative
        to what complete shapes have of each other.
    """
    targets = [one.moved(transform) for one, transform in zip(partners, transforms, strict=True)]
    sizes = sizes_of_complete(transforms, estimate_scale=estimate_scale)
    if fixed_transform is not None:
        return pose_record(targets, source, Similarity.of_transforms(fixed_transform[None]))
    asked = [sizes] * (NUM_PROPOSERS - 1) + [
        sizes if not estimate_scale else None
    ]  # files may be of one size each
    found = [
        propose_poses(
            target, source, group=group, scale_range=size or scales_allowed([target], source)
        ).transform
        for target, size in zip(targets, asked, strict=False)
    ]
    if not any(map(len, found)):
        found = [_centred(targets[0], source, sizes)]
    proposed = Similarity.of_transforms(np.concatenate(found))
    poses = settle(targets, source, proposed, sizes=sizes, fixed=fixed)
    return pose_record(targets, source, poses)


def _centred(target: PartialSurface, source: PartialSurface, sizes: Sizes | None) -> FloatArray:
    """Return the transform (1, 4, 4) of a source to the centre and, within sizes, the radius of a target."""
    ratio = target.radius / source.radius
    scale = ratio if sizes is None else float(np.clip(ratio, *sizes))
    centred = np.diag([scale, scale, scale, 1.0])
    centred[:3, 3] = target.centre - scale * source.centre
    return centred[None]


@one_blas_thread()
def place_again(
    source: PartialSurface,
    partners: tuple[PartialSurface, ...],
    transforms: FloatArray,
    proposed: FloatArray,
    *,
    estimate_scale: bool,
) -> Record:
    """Return what :func:`place_shape` does, of proposed poses (p, 4, 4) to the common frame; runs inside a worker."""
    targets = [one.moved(transform) for one, transform in zip(partners, transforms, strict=True)]
    sizes = sizes_of_complete(transforms, estimate_scale=estimate_scale)
    poses = settle(targets, source, Similarity.of_transforms(proposed), sizes=sizes)
    return pose_record(targets, source, poses)


def sizes_of_complete(transforms: FloatArray, *, estimate_scale: bool) -> Sizes | None:
    """Return the scales of an incomplete shape by the transforms (n, 4, 4) of complete ones, if they say anything."""
    if not estimate_scale:
        return 1.0, 1.0
    logs, (deviations, least, most) = np.log(scales_of(transforms)), KNOWN_SIZES
    spread = max(float(logs.std(ddof=1)), least) if len(logs) > 1 else np.inf
    low, high = np.exp(logs.mean() + deviations * min(spread, most) * np.array([-1.0, 1.0]))
    return (float(low), float(high)) if spread < most else None


def pose_record(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    poses: Similarity,
) -> Record:
    """Return what is known of the poses, the best first, as :func:`place_shape` says."""
    found = [counterparts(target, source, poses, TUNED.num_points[1]) for target in targets]
    return {
        "rotations": poses.rotation,
        "transforms": poses.transform,
        "evidence": pose_evidence(targets, source, poses, found),
        "energies": np.stack([item.energies for item in found], axis=1),
        "overlaps": np.stack([item.overlaps()[0] for item in found]),
        "likeness": _likeness(targets, found),
        "beyond": beyond_rim(source, targets, poses),
        "on_rim": float(source.on_rim.mean()),
        "mismatch": part_mismatch(source, targets, poses),
    }


def settle(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    proposed: Similarity,
    *,
    sizes: Sizes | None,
    fixed: FloatArray | None = None,
) -> Similarity:
    """Return the proposed poses that are likeliest on targets in one frame, refined on all, the best first.

    Scales stay within ``sizes`` where they are known; a rotation (3, 3) that is ``fixed`` stays.
    """
    few, many = TUNED.num_points
    if fixed is not None:
        kept = np.argsort(pose_angle_deg(proposed.rotation, fixed), kind="stable")[:NUM_REFINED]
        proposed = replace(proposed[kept], rotation=np.tile(fixed, (len(kept), 1, 1)))
    proposed = _likeliest(targets, source, proposed, few)
    low, high = sizes or scales_allowed(targets, source)
    allowed = (
        np.minimum(low, proposed.scale),
        np.maximum(high, proposed.scale),
    )  # another size may have been proposed
    poses = refine(targets, source, proposed, scale_range=allowed, hold_rotations=fixed is not None)
    return _likeliest(targets, source, poses, many)


def _likeliest(
    targets: Sequence[PartialSurface], source: PartialSurface, poses: Similarity, num_points: int
) -> Similarity:
    """Return the distinct poses of most log-odds."""
    found = [counterparts(target, source, poses, num_points) for target in targets]
    odds = log_odds(pose_evidence(targets, source, poses, found))
    radius = float(np.mean([target.radius for target in targets]))
    return poses[distinct_similarities(poses, -odds, NUM_REFINED, radius)]


def pose_evidence(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    poses: Similarity,
    found: Sequence[Counterparts],
) -> FloatArray:
    """Return three kinds of evidence of poses (3, p): how probable the shape is there if the targets are of its kind.

    A point of it may come from any of the targets. A point of a target that has a counterpart costs what it costs
    more on the shape than on the other targets, less what a rougher shape costs everywhere, as at the pose where its
    own points cost least. Others are lacking if what is nearest to them is no rim of the shape. A shape without any
    rim lacks nothing: a scanner or a segmentation may have closed its breaks.
    """
    likelihoods = sum(1.0 / _bounded(one.source_costs) for one in found) / len(found)
    own = -np.log(likelihoods).mean(axis=1)
    usual = _usual_costs(targets, max(one.target_costs.shape[1] for one in found))
    shared = [one.target_costs < TUNED.counterpart**2 for one in found]
    excess = [
        np.log(_bounded(one.target_costs)) - expected
        for one, expected in zip(found, usual, strict=True)
    ]
    best = int(own.argmin())
    everywhere = np.concatenate(
        [one[best][has[best]] for one, has in zip(excess, shared, strict=True)]
    )
    roughness = max(float(np.median(everywhere)), 0.0) if len(everywhere) else 0.0
    tree = scipy.spatial.cKDTree(source.points)
    others, lacking = np.zeros((2, len(own)))
    for target, one, has in zip(targets, excess, shared, strict=True):
        clipped = np.clip(one - roughness, *EXCESS_RANGE)
        others += np.where(has, clipped, 0.0).mean(axis=1) / len(targets)
        if source.on_rim.any():
            lacks = ~has
            lacks[lacks] = ~source.on_rim[
                tree.query(poses.undo(target.points[: has.shape[1]])[lacks])[1]
            ]
            lacking += lacks.mean(axis=1) / len(targets)
    return np.stack([own, others, lacking])


def _likeness(targets: Sequence[PartialSurface], found: Sequence[Counterparts]) -> float:
    """Return which share of a shape has a counterpart at the first pose, relative to the targets on each other."""
    own = np.median([one.overlaps()[0, 1] for one in found])
    usual = [
        counterparts(first, second, _STILL, TUNED.num_points[1]).overlaps()
        for first, second in combinations(targets, 2)
    ]
    among_targets = float(np.median(usual)) if usual else 0.0
    return float(own) / among_targets if among_targets > 0.0 else float("nan")


def _usual_costs(targets: Sequence[PartialSurface], num_points: int) -> list[FloatArray]:
    """Return the logarithm of what each target's points cost on the others, by their median, each (l,)."""
    costs: list[list[FloatArray]] = [[] for _ in targets]
    for (a, first), (b, second) in combinations(enumerate(targets), 2):
        found = counterparts(first, second, _STILL, num_points)
        costs[a].append(found.target_costs[0])
        costs[b].append(found.source_costs[0])
    costs = (
        costs
        if len(targets) > 1
        else [[np.full(len(targets[0].points[:num_points]), TUNED.resolution**2)]]
    )
    return [np.median(np.log(_bounded(np.array(one))), axis=0) for one in costs]


def _bounded(costs: FloatArray) -> FloatArray:
    """Return costs, none of which is more than absent or less than noise."""
    return np.asarray(np.minimum(costs, TUNED.cutoff**2) + TUNED.resolution**2)


def pose_chance(record: Record) -> float:
    """Return how probable the best pose of a record is."""
    return share_of_best(np.asarray(record["rotations"]), log_odds(np.asarray(record["evidence"])))


def nearest_labels(positions: FloatArray, consensus: FloatArray) -> IntArray:
    """Return the label of each sample (k, 3), -1 where none of the consensus (l, 3) is near, shape (k,).

    A one-to-one assignment of least squared distance in which leaving a sample out costs the squared distance that
    points of the consensus lie apart.
    """
    spacing = float(np.median(scipy.spatial.cKDTree(consensus).query(consensus, k=2)[0][:, 1]))
    costs = np.minimum(
        scipy.spatial.distance.cdist(positions, consensus, "sqeuclidean"), spacing**2
    )
    rows, columns = scipy.optimize.linear_sum_assignment(costs)
    labels = np.full(len(positions), -1, dtype=np.int64)
    is_near = costs[rows, columns] < spacing**2
    labels[rows[is_near]] = columns[is_near]
    return labels
