"""What surfaces of two whole shapes say of a pose of their pair: descriptors, overlap, and gaps of dense points."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from data_tools.arrays import CACHED_ENTRIES, FloatArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.poses import SAME_DEG, Similarity, keep_apart
from pairwise.features.overlap import closeness, match_overlapping
from pairwise.features.poses import refine_on_planes

#: Points of either surface that are compared at a pose.
NUM_COMPARED = 250
#: Where the likeliest pose overlaps less than this, poses are looked for on which neighbourhoods agree.
CONVINCING = 0.5
#: Points of either surface that such a search takes, and poses that it proposes.
NUM_SEARCHED, NUM_PROPOSED = 400, 4


def local_evidence(
    target: Samples, source: Samples, rotations: FloatArray, *, num_points: int = NUM_COMPARED
) -> tuple[FloatArray, FloatArray]:
    """Return the mismatch and the overlap of two shapes at each of some poses, each (m,); NaN where unknown.

    The shapes lie with their centroids and sizes on each other.

    Parameters
    ----------
    target, source : Samples
    rotations : ndarray, shape (m, d, d)
        ``R_target_source`` in the embedding; space comes first.
    num_points : int
        Points of either surface that are compared, at most.
    """
    unknown = np.full(len(rotations), np.nan)
    if target.local is None or source.local is None:
        return read_only(unknown), read_only(unknown)
    mismatch, overlap = unknown.copy(), unknown.copy()
    space = rotations[:, :3, :3]
    are_proper = np.linalg.det(space) > 0
    for proper, other, flip in (
        (True, source.local, np.ones(3)),
        (False, None, np.array([-1.0, 1.0, 1.0])),
    ):
        chosen = are_proper == proper
        if chosen.any():
            of = source.local.mirrored if other is None else other
            flipped = space[chosen] * flip
            shares, costs = closeness(
                target.local, of, flipped, np.zeros((len(flipped), 3)), num_points=num_points
            )
            mismatch[chosen], overlap[chosen] = costs.mean(axis=1), np.sqrt(shares.prod(axis=1))
    return read_only(mismatch), read_only(overlap)


def rigid_overlap(target: Samples, source: Samples, rotations: FloatArray) -> float:
    """Return the most that two surfaces overlap at some rotations (m, d, d), each refined, also in place.

    Parameters
    ----------
    target, source : Samples
        Where neighbourhoods are not described, the overlap is 0.
    rotations : ndarray, shape (m, d, d)
        ``R_target_source`` in the embedding; space comes first.
    """
    most = 0.0
    if target.local is None or source.local is None:
        return most
    for rotation in rotations[:, :3, :3]:
        flip = np.array([np.sign(np.linalg.det(rotation)), 1.0, 1.0])
        other = source.local if flip[0] > 0 else source.local.mirrored
        start = Similarity.rigid((rotation * flip)[None], np.zeros((1, 3)))
        pose = refine_on_planes(target.local, other, start)
        overlaps = closeness(target.local, other, pose.rotation, pose.shift)[0]
        most = max(most, float(np.sqrt(overlaps.prod())))
    return most


def proposed_rotations(
    target: Samples, source: Samples, group: str, known: FloatArray
) -> FloatArray:
    """Return rotations (p, 3, 3) on which neighbourhoods agree, apart from those that are known (m, d, d)."""
    if target.local is None or source.local is None:
        return np.empty((0, 3, 3))
    ends = (local.thinned(NUM_SEARCHED) for local in (target.local, source.local))
    found = match_overlapping(*ends, group=group, num_candidates=NUM_PROPOSED).rotations
    every = np.concatenate([known[:, :3, :3], found])
    kept = keep_apart(every, SAME_DEG)
    return every[[k for k in kept if k >= len(known)]]


#: Dense points of each shape that are compared, of one shape the even and of the other the odd ones: otherwise copies
#: that share their samples would tell poses apart that look the same.
NUM_POINTS = 250
#: Weight of unit normals relative to positions of root mean square radius 1.
NORMAL_WEIGHT = 0.3


def surface_gap(
    target: tuple[FloatArray, FloatArray],
    source: tuple[FloatArray, FloatArray],
    rotations: FloatArray,
) -> FloatArray:
    """Return the mean squared distances of closest points both ways at rotations (m, 3, 3), shape (m,)."""
    both_ways = [
        0.5 * (gaps.min(axis=1).mean(axis=1) + gaps.min(axis=2).mean(axis=1))
        for gaps in point_gaps(target, source, rotations)
    ]
    return np.maximum(np.concatenate([np.empty(0), *both_ways]), 0.0)


def point_gaps(
    target: tuple[FloatArray, FloatArray],
    source: tuple[FloatArray, FloatArray],
    rotations: FloatArray,
) -> Iterator[FloatArray]:
    """Yield |t|^2 - 2 ts + |s|^2 of points (n, 3), (k, 3) and normals at rotations (p, 3, 3), some at a time.

    Each is of shape (some, n, k), as large as fits the cache, and written over the one before.
    """
    num = 2 if len(target[1]) > 0 < len(source[1]) else 1
    to, of = (np.hstack([p, NORMAL_WEIGHT * n][:num]) for p, n in (target, source))
    left = np.column_stack([-2.0 * to, (to**2).sum(axis=1), np.ones(len(to))])
    right = np.empty((len(rotations), 3 * num + 2, len(of)))
    turned = rotations[:, None] @ of.T.reshape(num, 3, -1)
    right[:, :-2] = turned.reshape(len(rotations), 3 * num, -1)
    right[:, -2:] = np.ones(len(of)), (of**2).sum(axis=1)
    some = max(1, CACHED_ENTRIES // (len(to) * len(of)))
    gaps = np.empty((some, len(to), len(of)))
    for first in range(0, len(rotations), some):
        each = right[first : first + some]
        yield np.matmul(left, each, out=gaps[: len(each)])


def surface_points(samples: Samples, *, first: int) -> tuple[FloatArray, FloatArray]:
    """Return every second dense point, in radii about the mean of all, and their normals, both (n, 3).

    Of a table all points: its halves have nothing in common. Without dense points every second sample of a surface,
    whose copies share its samples.
    """
    if samples.is_table:
        return all_points(samples)
    if len(samples.dense_positions) < 2:
        return _normalised(samples.positions)[first::2], np.empty((0, 3))
    chosen = slice(first, 2 * NUM_POINTS, 2)
    return _normalised(samples.dense_positions)[chosen], samples.dense_normals[chosen]


def all_points(samples: Samples) -> tuple[FloatArray, FloatArray]:
    """Return the dense points of a cloud, or its samples without any, as :func:`surface_points`, without normals."""
    dense = samples.dense_positions
    points = dense if len(dense) > 1 else samples.positions
    return _normalised(points)[: 2 * NUM_POINTS], np.empty((0, 3))


def _normalised(points: FloatArray) -> FloatArray:
    """Return points of mean zero and root mean square radius 1."""
    centred = points - points.mean(axis=0)
    return np.asarray(
        centred / max(float(np.sqrt((centred**2).sum(axis=1).mean())), np.finfo(float).tiny)
    )
