"""Poses one incomplete shape on several posed ones: each proposes poses, and all together decide and refine them.

A shape that is not symmetric itself may look so where a part is missing, and a single partner may fit badly where it
differs. What is common to the partners decides: every pose that fits one of them is tried on all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from collalign.confidence.overlap_model import certainty, rival_margin
from collalign.engine.store.records import Record
from collalign.stages.incomplete.posed_points import posed_points
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.surface_points import OrientedPoints
from data_tools.poses import AGREE_DEG, Similarity, turn_deg
from data_tools.threads import one_blas_thread
from pairwise.partial.counterparts import counterparts
from pairwise.partial.match import distinct_similarities, match_partial, refine, scales_allowed
from pairwise.partial.surface import PartialSurface
from pairwise.partial.tuning import TUNED

#: Partners that propose poses, those that each proposes, and those of all that are refined on all partners.
NUM_PROPOSERS, NUM_PROPOSED, NUM_REFINED = 4, 8, 6
#: Poses beyond twice a rival's angle from the best one that are refined as well: without rivals nothing is in doubt.
NUM_RIVALS = 3


@one_blas_thread()
def place_shape(
    shape: OrientedPoints,
    partners: tuple[OrientedPoints, ...],
    transforms: FloatArray,
    group: str,
    estimate_scale: bool,
    fixed: FloatArray | None = None,
    fixed_transform: FloatArray | None = None,
) -> Record:
    """Return the poses of a shape on its partners, the best first; runs inside a worker.

    Parameters
    ----------
    shape : OrientedPoints
    partners : tuple of OrientedPoints
    transforms : ndarray, shape (n, 4, 4)
        File coordinates of the partners to the common frame.
    group : {"SO", "O"}
    estimate_scale : bool
    fixed : ndarray, shape (3, 3), or None
        A rotation that a person has decided.
    fixed_transform : ndarray, shape (4, 4), or None
        A whole transform that stays: nothing is searched then.

    Returns
    -------
    dict
        ``turns`` (m, 3, 3), ``scales`` (m,), ``shifts`` (m, 3): file coordinates to the common frame; ``energies``
        (m, n) with each partner; ``overlaps`` (n, 2), see :class:`collalign.products.incomplete.Incomplete`;
        ``proposed`` (q, p, 3, 3) and ``proposed_energies`` (q, p), what each of the first partners alone asks for,
        padded by its best.
    """
    source = posed_points(shape)
    targets = [posed_points(one, transform) for one, transform in zip(partners, transforms, strict=True)]
    if fixed_transform is not None:
        pose = Similarity.of_transforms(fixed_transform[None])
        return pose_record(targets, source, pose, np.zeros((0, 1, 3, 3)), np.zeros((0, 1)))
    alone = [
        match_partial(
            target,
            source,
            group=group,
            estimate_scale=estimate_scale,
            num_candidates=NUM_PROPOSED,
        )
        for target in targets[:NUM_PROPOSERS]
    ]
    every = [pose for poses in alone for pose in poses]
    proposed = Similarity(
        rotation=np.stack([one.pose.rotation for one in every]),
        scale=np.array([one.pose.scale for one in every]),
        shift=np.stack([one.pose.shift for one in every]),
    )
    padded = [[*asked, *[asked[0]] * (NUM_PROPOSED - len(asked))] for asked in alone]
    return pose_record(
        targets,
        source,
        settle(targets, source, proposed, estimate_scale=estimate_scale, fixed=fixed),
        np.array([[one.pose.rotation for one in asked] for asked in padded]),
        np.array([[pose.energy for pose in asked] for asked in padded]),
    )


def pose_record(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    poses: Similarity,
    proposed: FloatArray,
    proposed_energies: FloatArray,
) -> Record:
    """Return what is known of the poses, the best first, as :func:`place_shape` says."""
    found = [counterparts(target, source, poses[:1], TUNED.num_points[1]) for target in targets]
    return {
        "turns": poses.rotation,
        "scales": poses.scale,
        "shifts": poses.shift,
        "energies": energies_on(targets, source, poses, TUNED.num_points[1]),
        "overlaps": np.concatenate([item.overlaps() for item in found]),
        "proposed": proposed,
        "proposed_energies": proposed_energies,
    }


def settle(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    proposed: Similarity,
    *,
    estimate_scale: bool,
    fixed: FloatArray | None = None,
) -> Similarity:
    """Return the proposed poses that fit all targets best, refined on all, the best first.

    Parameters
    ----------
    targets : sequence of PartialSurface
        In one frame.
    source : PartialSurface
    proposed : Similarity
    estimate_scale : bool
    fixed : ndarray, shape (3, 3), optional
        A rotation that stays.
    """
    radius = float(np.mean([target.radius for target in targets]))
    ranges = [scales_allowed(target, source, estimate_scale=estimate_scale) for target in targets]
    scale_range = min(low for low, _ in ranges), max(high for _, high in ranges)
    if fixed is not None:
        apart = turn_deg(proposed.rotation, fixed)
        kept = np.argsort(apart, kind="stable")[:NUM_REFINED]
        proposed = replace(proposed[kept], rotation=np.tile(fixed, (len(kept), 1, 1)))
    else:
        energies = np.log(energies_on(targets, source, proposed, TUNED.num_points[0])).mean(axis=1)
        proposed = proposed[_with_rivals(proposed, energies, radius)]
    poses = refine(targets, source, proposed, scale_range=scale_range, hold_turns=fixed is not None)
    energies = energies_on(targets, source, poses, TUNED.num_points[1])
    return poses[distinct_similarities(poses, np.log(energies).mean(axis=1), NUM_REFINED + NUM_RIVALS, radius)]


def _with_rivals(poses: Similarity, energies: FloatArray, radius: float) -> IntArray:
    """Return the poses of least energy, and those of least energy that are far from the very best."""
    best = distinct_similarities(poses, energies, NUM_REFINED, radius)
    apart = turn_deg(poses.rotation, poses.rotation[best[0]]) > 2.0 * AGREE_DEG
    rivals = np.flatnonzero(apart)
    if not len(rivals):
        return best
    rivals = rivals[distinct_similarities(poses[rivals], energies[rivals], NUM_RIVALS, radius)]
    return np.concatenate([best, np.setdiff1d(rivals, best)])


def energies_on(
    targets: Sequence[PartialSurface], source: PartialSurface, poses: Similarity, num_points: int
) -> FloatArray:
    """Return the energy of every pose on every target, shape (p, n)."""
    return np.stack([counterparts(target, source, poses, num_points).energies for target in targets], axis=1)


def pose_certainty(record: Record) -> float:
    """Return how probable the best pose is against its rivals, see :mod:`collalign.confidence.overlap_model`."""
    energies = np.asarray(record["energies"])
    return certainty(rival_margin(np.asarray(record["turns"]), energies), energies.shape[1])


def nearest_labels(positions: FloatArray, consensus: FloatArray) -> IntArray:
    """Return the label of each sample, -1 where none of the consensus is near, shape (k,).

    A one-to-one assignment of least squared distance in which leaving a sample out costs the squared distance that
    points of the consensus lie apart.

    Parameters
    ----------
    positions : ndarray, shape (k, 3)
        In the common frame.
    consensus : ndarray, shape (l, 3)
    """
    spacing = float(np.median(cKDTree(consensus).query(consensus, k=2)[0][:, 1]))
    costs = np.minimum(cdist(positions, consensus, "sqeuclidean"), spacing**2)
    rows, columns = linear_sum_assignment(costs)
    labels = np.full(len(positions), -1, dtype=np.int64)
    is_near = costs[rows, columns] < spacing**2
    labels[rows[is_near]] = columns[is_near]
    return labels
