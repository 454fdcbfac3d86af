"""Poses on which matches of descriptors agree, refined point to plane.

No centroid, size or whole shape enters: what two surfaces share decides, however little that is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import FloatArray, IntArray
from data_tools.local_surface import MOST_COMPARED, LocalSurface, SurfacePlanes
from data_tools.poses import Similarity, pose_angle_deg
from data_tools.rotations import nearest_orthogonal

_Floats: TypeAlias = NDArray[np.floating[Any]]

#: Descriptors that each point is matched with, and matches that are looked at, the most telling ones.
NUM_NEAREST, MOST_MATCHES = 2, 600
#: Two matches are compatible if the distance of their points agrees within so many cells, ...
SAME_CELLS = 1.5
#: ... if they are at least so many cells apart, ...
APART_CELLS = 2.0
#: ... if the cosines between their two normals agree within this, ...
SAME_COSINE = 0.4
#: ... and if those between normals and connection do within this (and half a cell).
SAME_SLOPE = 0.35
#: Rounds of so many seeds; matches that a round explains seed no later one.
NUM_ROUNDS, NUM_SEEDS = 3, 60
#: Matches that a seed's pose is computed from: those that share most compatible matches with it.
NUM_SUPPORT = 24
#: A match counts for a pose if its normals agree up to this cosine.
MATCH_COSINE = 0.6
#: Poses nearer than this, in degrees and in cells, are one.
SAME_POSE_DEG, SAME_POSE_CELLS = 15.0, 5.0
#: Cutoffs of the refinement's steps that bring a pose near, and of those that make it exact, in cells; cosine of
#: normals from which two points count.
FIRST_STEPS, LAST_STEPS, STEP_COSINE = (3.0, 3.0, 3.0, 2.0, 2.0, 2.0), (1.2, 1.2, 1.2), 0.5
#: Most that a step of the refinement rotates, in radians, and scales, as a logarithm; points that a step needs.
LONGEST_STEP_RAD, LONGEST_STEP, FEWEST_POINTS = 0.3, 0.1, 12


def feature_distances(
    target: NDArray[np.float32], source: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the squared Hellinger distances of descriptors (l, 33) and (m, 33), shape (l, m), between 0 and 2."""
    return np.asarray(2.0 - 2.0 * (target @ source.T), dtype=np.float32)


def match_features(distances: NDArray[np.float32]) -> tuple[IntArray, IntArray]:
    """Return the nearest descriptors of each point, both ways, as indices on the target and on the source, each (m,).

    Of many the most telling ones: those whose distance is small compared with the mean one of either point.

    Parameters
    ----------
    distances : ndarray, shape (l, m)
        As :func:`feature_distances` returns them.
    """
    from pairwise.features.votes import least_both_ways

    num_target, num_source = distances.shape
    there, back = least_both_ways(
        distances, min(NUM_NEAREST, num_source), min(NUM_NEAREST, num_target)
    )
    found = (
        np.arange(num_target)[:, None] * num_source + there,
        back * num_source + np.arange(num_source)[:, None],
    )
    to, of = np.divmod(np.unique(np.concatenate(found, axis=None)), num_source)
    if len(to) > MOST_MATCHES:
        usual = np.minimum(distances.mean(axis=1)[to], distances.mean(axis=0)[of])
        kept = np.sort(np.argsort(distances[to, of] / usual, kind="stable")[:MOST_MATCHES])
        to, of = to[kept], of[kept]
    return to, of


def consensus_poses(
    target: LocalSurface, source: LocalSurface, matches: tuple[IntArray, IntArray], num: int
) -> tuple[FloatArray, FloatArray]:
    """Return distinct rigid poses on which most matches agree, rotations (p, 3, 3) and shifts (p, 3).

    Matches vote for each other where a rigid motion can hold both; what counts for a seed are the compatible matches
    that two compatible matches share (second order spatial compatibility: Chen, Sun, Yang and Tao, CVPR 2022).

    Parameters
    ----------
    target, source : LocalSurface
        Of one unit of length.
    matches : pair of ndarray of int, each (m,)
    num : int
        At most so many poses, those of most matches.
    """
    cell = max(target.cell, source.cell)
    centre_to, centre_of = target.points.mean(axis=0), source.points.mean(axis=0)
    to, of = target.points[matches[0]] - centre_to, source.points[matches[1]] - centre_of
    normals_to, normals_of = target.normals[matches[0]], source.normals[matches[1]]
    compatible = _compatible((to, normals_to), (of, normals_of), cell)
    degrees = compatible.sum(axis=1)
    free = np.ones(len(to), dtype=np.bool_)
    found_rotations, found_shifts, found_support = [], [], []
    for _ in range(NUM_ROUNDS):
        seeds = np.argsort(-np.where(free, degrees, -1.0), kind="stable")[:NUM_SEEDS]
        seeds = seeds[free[seeds] & (degrees[seeds] > 2)]
        if not len(seeds):
            break
        shared = (compatible[seeds] @ compatible) * compatible[seeds]
        closest = np.argpartition(-shared, min(NUM_SUPPORT, shared.shape[1]) - 1, axis=1)[
            :, :NUM_SUPPORT
        ]
        weights = np.zeros(shared.shape)
        np.put_along_axis(weights, closest, np.take_along_axis(shared, closest, axis=1), axis=1)
        weights[np.arange(len(seeds)), seeds] = weights.max(axis=1)
        agree = weights
        for _ in range(2):
            rotations, shifts = _procrustes(to, of, agree)
            agree = _explained(
                (to, normals_to), (of, normals_of), rotations, shifts, SAME_CELLS * cell
            )
        shifts = shifts + centre_to - rotations @ centre_of
        held = np.asarray(agree.sum(axis=1), dtype=np.float64)
        kept = poses_apart(rotations, shifts, held, source, cell, num)
        found_rotations.append(rotations[kept])
        found_shifts.append(shifts[kept])
        found_support.append(held[kept])
        free &= ~agree[kept].any(axis=0)
    if not found_rotations:
        return np.empty((0, 3, 3)), np.empty((0, 3))
    rotations, shifts = np.concatenate(found_rotations), np.concatenate(found_shifts)
    kept = poses_apart(rotations, shifts, np.concatenate(found_support), source, cell, num)
    return rotations[kept], shifts[kept]


def refine_on_planes(
    target: SurfacePlanes,
    source: SurfacePlanes,
    poses: Similarity,
    *,
    cutoffs: Sequence[float] = FIRST_STEPS + LAST_STEPS,
    num_points: int = MOST_COMPARED,
    scale_range: tuple[float | FloatArray, float | FloatArray] | None = None,
    hold_rotations: bool = False,
    sides_known: bool = True,
) -> Similarity:
    """Refine poses by least squares from points to planes (Chen and Medioni 1992), trimmed.

    Parameters
    ----------
    target, source : SurfacePlanes
    poses : Similarity
        Several; source coordinates to those of the target.
    cutoffs : sequence of float
        Of the steps, in cells.
    num_points : int
        Points of the source that are brought to the target, at most.
    scale_range : pair of float or ndarray (p,), optional
        The least and the largest scale, of all poses or of each; without it, scales stay.
    hold_rotations : bool
        Only shifts and scales change.
    sides_known : bool
        Whether normals of both are on the same side of the surface; if not, either side of a point may face another.
    """
    cell = max(target.cell, source.cell)
    few = source.few(num_points)
    points, normals = source.points[few], source.normals[few]
    rotations, scales, shifts = poses.rotation, np.asarray(poses.scale), poses.shift
    for cutoff in cutoffs:
        back = np.swapaxes(rotations, 1, 2)
        placed = points @ (scales[:, None, None] * back) + shifts[:, None]
        distances, nearest = target.tree.query(
            placed.reshape(-1, 3), distance_upper_bound=cutoff * cell
        )
        is_near = np.isfinite(distances).reshape(placed.shape[:2])
        nearest = np.where(is_near, nearest.reshape(placed.shape[:2]), 0)
        planes = target.normals[nearest]
        cosines = (planes * (normals @ back)).sum(axis=2)
        cosines = cosines if sides_known else np.abs(cosines)
        weights = (is_near & (cosines > STEP_COSINE)).astype(np.float64)
        counts = weights.sum(axis=1)
        means = (weights[:, None] @ placed)[:, 0] / np.maximum(counts, 1.0)[:, None]
        arms = placed - means[:, None]
        gaps = ((target.points[nearest] - placed) * planes).sum(axis=2)
        columns = [planes] if hold_rotations else [np.cross(arms, planes), planes]
        if scale_range is not None:
            columns.append((arms * planes).sum(axis=2, keepdims=True))
        rows = np.concatenate(columns, axis=2)
        weighted = np.swapaxes(rows * weights[:, :, None], 1, 2)
        moments = weighted @ rows
        # What no plane holds (a sphere rotates in itself) stays.
        damping = 1e-6 * np.trace(moments, axis1=1, axis2=2) + np.finfo(float).tiny
        moments += damping[:, None, None] * np.eye(rows.shape[2])
        steps = np.linalg.solve(moments, weighted @ gaps[:, :, None])[:, :, 0]
        steps[counts < FEWEST_POINTS] = 0.0
        turns, slides = np.zeros((len(steps), 3)), steps[:, :3]
        if not hold_rotations:
            turns, slides = steps[:, :3], steps[:, 3:6]
        lengths = np.linalg.norm(turns, axis=1, keepdims=True)
        turns = turns * np.minimum(1.0, LONGEST_STEP_RAD / np.maximum(lengths, LONGEST_STEP_RAD))
        corrections = rotations_by(turns)
        moved = (corrections @ (shifts - means)[:, :, None])[:, :, 0]
        if scale_range is not None:
            before = scales
            grown = np.exp(np.clip(steps[:, -1], -LONGEST_STEP, LONGEST_STEP))
            scales = np.clip(before * grown, *scale_range)
            moved *= (scales / before)[:, None]
        shifts = moved + means + slides
        rotations = corrections @ rotations
    return Similarity(rotation=rotations, scale=scales, shift=shifts)


def poses_apart(
    rotations: FloatArray,
    shifts: FloatArray,
    scores: FloatArray,
    source: LocalSurface,
    cell: float,
    num: int,
    *,
    same: tuple[float, float] = (SAME_POSE_DEG, SAME_POSE_CELLS),
) -> list[int]:
    """Return at most ``num`` poses (p, 3, 3), (p, 3) that differ in rotation or place, by scores (p,), best first.

    Those within so many degrees and cells are the ``same``.
    """
    places = rotations @ source.points.mean(axis=0) + shifts
    are_apart = pose_angle_deg(rotations[:, None], rotations) > same[0]
    are_apart |= np.linalg.norm(places[:, None] - places, axis=2) > same[1] * cell
    kept: list[int] = []
    for p in np.argsort(-np.asarray(scores), kind="stable").tolist():
        if are_apart[p, kept].all():
            kept.append(p)
        if len(kept) == num:
            break
    return kept


def _compatible(
    target: tuple[FloatArray, FloatArray], source: tuple[FloatArray, FloatArray], cell: float
) -> NDArray[np.float32]:
    """Return 1 where a rigid motion can hold two matches, else 0, shape (m, m)."""
    lengths, slopes, cosines = zip(*(_relations(*side) for side in (target, source)), strict=True)
    shortest = np.minimum(*lengths)
    agree = np.abs(lengths[0] - lengths[1]) < SAME_CELLS * cell
    agree &= shortest > APART_CELLS * cell
    agree &= np.abs(cosines[0] - cosines[1]) < SAME_COSINE
    agree &= np.abs(slopes[0] - slopes[1]) < SAME_SLOPE * shortest + 0.5 * cell
    agree &= agree.T
    return agree.astype(np.float32)


def _relations(points: FloatArray, normals: FloatArray) -> tuple[_Floats, _Floats, _Floats]:
    """Return distances of points, heights over each other's tangent planes, and cosines of normals, each (m, m)."""
    places, directions = (
        (points - points.mean(axis=0)).astype(np.float32),
        normals.astype(np.float32),
    )
    squares = (places * places).sum(axis=1)
    lengths = np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * places @ places.T, 0.0))
    heights = directions @ places.T - (directions * places).sum(axis=1)[:, None]
    return lengths, heights, directions @ directions.T


def _explained(
    target: tuple[FloatArray, FloatArray],
    source: tuple[FloatArray, FloatArray],
    rotations: FloatArray,
    shifts: FloatArray,
    reach: float,
) -> FloatArray:
    """Return 1 where a match lies within reach at a pose and its normals agree, else 0, shape (p, m)."""
    (to, normals_to), (of, normals_of) = target, source
    flat = rotations.reshape(-1, 9)
    cosines = flat @ _products(normals_to, normals_of).T
    # |R of + shift - to|^2, each product of a pose and a match by itself: no array of differences.
    squares = (to**2).sum(axis=1) + (of**2).sum(axis=1) + (shifts**2).sum(axis=1)[:, None]
    squares += 2.0 * ((shifts[:, None] @ rotations)[:, 0] @ of.T - shifts @ to.T)
    squares -= 2.0 * flat @ _products(to, of).T
    return np.asarray((squares < reach**2) & (cosines > MATCH_COSINE), dtype=np.float64)


def _products(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the products of every two coordinates, shape (m, 9), of vectors (m, 3)."""
    return (first[:, :, None] * second[:, None]).reshape(-1, 9)


def _procrustes(
    to: FloatArray, of: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the rigid poses that fit weighted matches best, weights (p, m); rotations (p, 3, 3), shifts (p, 3)."""
    shares = weights / np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    means_to, means_of = shares @ to, shares @ of
    moments = (shares @ _products(to, of)).reshape(-1, 3, 3)
    moments -= means_to[:, :, None] * means_of[:, None]
    rotations = nearest_orthogonal(moments, determinant=1.0)
    return rotations, means_to - (rotations @ means_of[:, :, None])[:, :, 0]


def rotations_by(vectors: FloatArray) -> FloatArray:
    """Return the rotations about vectors (p, 3) by their lengths, shape (p, 3, 3)."""
    angles = np.linalg.norm(vectors, axis=1)[:, None, None]
    crosses = np.zeros((len(vectors), 3, 3))
    crosses[:, [2, 0, 1], [1, 2, 0]] = vectors
    crosses[:, [1, 2, 0], [2, 0, 1]] = -vectors
    safe = np.maximum(angles, 1e-12)
    return np.asarray(
        np.eye(3)
        + np.sin(safe) / safe * crosses
        + (1.0 - np.cos(safe)) / safe**2 * crosses @ crosses
    )
