"""Distances of posed surfaces by closest points: they need no correspondence of samples."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from collalign.output.collection import Collection
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.sampling import farthest_points
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread
from pairwise.dense.points import DensePoints
from pairwise.dense.refine import refine_pose

#: Points of each shape. Even points make closest points a measure of the surfaces alone.
NUM_POINTS = 400
#: Neighbours of each shape, by the poses as they are, whose distances are measured after refining the pose: a nearest
#: neighbour is one of these.
NUM_NEAR = 16


@one_blas_thread()
def surface_distances(
    clouds: Sequence[FloatArray], part_numbers: IntArray, *, num_near: int = NUM_NEAR
) -> FloatArray:
    """Return the closest-point distances of all pairs, shape (N, N); NaN between shapes of different part_numbers.

    A distance is the root mean square of the distances of each point to the nearest of the other shape, both ways, at
    the poses as they are. Pairs of near neighbours are turned, shifted and scaled to fit best first.

    Parameters
    ----------
    clouds : sequence of ndarray, each (k, 3)
        Evenly spread points of each surface at its pose, see :func:`unit_cloud`.
    part_numbers : ndarray of int, shape (N,)
        Shapes of different part_numbers are not aligned with each other.
    num_near : int

    Notes
    -----
    On 400 points of 116 molars, each left out once, the nearest neighbour is of the right genus for 97 of 99 (family
    104 of 106, order 115 of 116); by exact one-to-one matches of the same points for 92
    (``python -m experiments classification``). Root mean square distances of corresponding points, by
    :func:`collalign.dense_correspondence` at the poses of one run, are right for as many of each, and need
    two registrations of every shape.
    """
    distances = distances_at_poses(clouds)
    distances[part_numbers[:, None] != part_numbers] = np.nan
    points = [DensePoints.from_user(cloud) for cloud in clouds]
    for i, j in near_pairs(distances, num_near):
        distances[i, j] = distances[j, i] = refined_distance(points[i], points[j], np.eye(3))[0]
    return distances


def distances_at_poses(clouds: Sequence[FloatArray]) -> FloatArray:
    """Return the closest-point distances of all pairs as they stand, in parts of the radius, shape (N, N)."""
    trees = [cKDTree(cloud) for cloud in clouds]
    distances = np.zeros((len(clouds), len(clouds)))
    for i, j in itertools.combinations(range(len(clouds)), 2):
        squares = [trees[i].query(clouds[j])[0] ** 2, trees[j].query(clouds[i])[0] ** 2]
        num = 0.5 * (len(clouds[i]) + len(clouds[j]))
        distances[i, j] = distances[j, i] = np.sqrt(np.concatenate(squares).mean() * num)
    return distances


def posed_clouds(collection: Collection) -> list[FloatArray]:
    """Return farthest points of every display mesh, centred and of unit size in the common frame, each (k, 3)."""
    clouds = []
    for vertices, rotation in zip(collection.vertices, collection.rotations, strict=True):
        shape = Shape.from_arrays(vertices)
        chosen = farthest_points(shape, min(NUM_POINTS, len(vertices)), metric="euclidean")
        clouds.append(unit_cloud(vertices[chosen]) @ rotation.T)
    return clouds


def unit_cloud(points: FloatArray) -> FloatArray:
    """Return points centred and of unit centroid size, shape (k, 3)."""
    centred = points - points.mean(axis=0)
    return np.asarray(centred / np.linalg.norm(centred))


def near_pairs(distances: FloatArray, num: int) -> list[tuple[int, int]]:
    """Return the pairs (i < j) of which one is among the ``num`` nearest of the other, by distances (N, N)."""
    away = np.where(np.isnan(distances) | np.eye(len(distances), dtype=bool), np.inf, distances)
    nearest = np.argsort(away, axis=1, kind="stable")[:, :num]
    pairs = {(min(i, j), max(i, j)) for i, row in enumerate(nearest.tolist()) for j in row if np.isfinite(away[i, j])}
    return sorted(pairs)


def refined_distance(target: DensePoints, source: DensePoints, rotation: FloatArray) -> tuple[float, FloatArray]:
    """Refine a pose by closest points, both ways, with shift and scale.

    Returns
    -------
    distance : float
        Root mean square of the distances of closest points, in parts of the root mean square radius and in the units
        of the geometric mean of both sizes, so that target and source may be exchanged.
    rotation : ndarray, shape (3, 3)
        The refined ``R_target_source``.
    """
    refined = refine_pose(target, source, rotation)
    return float(np.sqrt(refined.energy / refined.pose.scale)) / target.radius, refined.pose.rotation
