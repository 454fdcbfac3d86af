"""Alignment by principal axes, iterated closest points and a spanning tree: what auto3dgm does.

Boyer et al. (2015), "A new fully automated approach for aligning and comparing shapes", The Anatomical Record 298.
Written from the paper as a yardstick: every pair starts from all pairings of the principal axes, points are matched
one to one, the minimum spanning tree of the distances carries the rotations to all shapes, and a second round with
more points starts from there.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial.distance import cdist

from collalign.engine.run_jobs import run_jobs
from data_tools.arrays import FloatArray
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import CollectionError, OptionsError
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.shape import Shape

#: Points of the first and of the second round, as auto3dgm's example has them.
NUM_POINTS = (100, 200)
MAX_ITERATIONS = 100
#: Longer edges of a mesh are split, in root mean square radii.
LONGEST_EDGE = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class _PairTask:
    target: FloatArray
    source: FloatArray
    starts: FloatArray


def align_by_principal_axes(
    shapes: Sequence[Shape],
    *,
    group: str = "SO",
    num_points: Sequence[int] = NUM_POINTS,
    num_jobs: int = 1,
) -> FloatArray:
    """Align shapes as auto3dgm does.

    Parameters
    ----------
    shapes : sequence of Shape, length N
    group : {"SO", "O"}
        Whether mirror images are allowed.
    num_points : sequence of int
        Points per shape in each round.
    num_jobs : int
        Worker processes.

    Returns
    -------
    ndarray, shape (N, 3, 3)
        ``R_common_shape``; the common frame is that of the first shape.
    """
    rotations = None
    dense = [with_short_edges(shape) for shape in shapes]
    for num in num_points:
        points = [normalised_points(shape, num) for shape in dense]
        rotations = along_tree(*_match_pairs(points, rotations, group, num_jobs))
    if rotations is None:
        raise OptionsError("num_points: expected at least one round")
    return rotations


def with_short_edges(shape: Shape) -> Shape:
    """Return the shape with long edges split, so that its vertices cover the surface; a point cloud as it is."""
    if not shape.is_mesh:
        return shape
    radius = np.sqrt(((shape.vertices - shape.vertices.mean(axis=0)) ** 2).sum(axis=1).mean())
    vertices, faces = trimesh.remesh.subdivide_to_size(
        shape.vertices, shape.faces, max_edge=LONGEST_EDGE * radius, max_iter=20
    )
    return Shape.from_arrays(vertices, faces, name=shape.name)


def normalised_points(shape: Shape, num: int) -> FloatArray:
    """Return farthest points, centred and of unit centroid size, shape (num, 3)."""
    points = shape.vertices[farthest_points(shape, num, metric="euclidean")]
    points = points - points.mean(axis=0)
    return np.asarray(points / np.linalg.norm(points))


def axis_starts(target: FloatArray, source: FloatArray, *, group: str = "SO") -> FloatArray:
    """Return the ways to put principal axes on principal axes, shape (4, 3, 3), with reflections (8, 3, 3)."""
    axes_target, axes_source = (
        np.linalg.svd(points, full_matrices=False)[2] for points in (target, source)
    )
    signs = np.array(list(itertools.product((1.0, -1.0), repeat=3)))
    starts = axes_target.T @ (signs[:, :, None] * axes_source)
    return np.asarray(starts if group == "O" else starts[np.linalg.det(starts) > 0])


def closest_points(
    target: FloatArray, source: FloatArray, start: FloatArray
) -> tuple[FloatArray, float]:
    """Match one to one and rotate in alternation until the match repeats; the start's chirality stays.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
        ``R_target_source``.
    distance : float
        Root of the sum of squared distances.
    """
    rotation, before = start, None
    side = np.sign(np.linalg.det(start))
    for _ in range(MAX_ITERATIONS):
        squared = cdist(target, source @ rotation.T, "sqeuclidean")
        match = linear_sum_assignment(squared)[1]
        if before is not None and (match == before).all():
            break
        before = match
        rotation = nearest_orthogonal(target.T @ source[match], determinant=side)
    return rotation, float(np.linalg.norm(target - source[match] @ rotation.T))


def along_tree(relative: FloatArray, distances: FloatArray) -> FloatArray:
    """Chain relative rotations along the minimum spanning tree of the distances.

    Parameters
    ----------
    relative : ndarray, shape (N, N, 3, 3)
        ``R_i_j``.
    distances : ndarray, shape (N, N)
        Symmetric.

    Returns
    -------
    ndarray, shape (N, 3, 3)
        ``R_common_shape``; the identity for the first shape.
    """
    tree = minimum_spanning_tree(np.maximum(distances, np.finfo(float).tiny))
    order, before = breadth_first_order(tree, 0, directed=False)
    rotations = np.tile(np.eye(3), (len(distances), 1, 1))
    for shape in order[1:]:
        rotations[shape] = rotations[before[shape]] @ relative[before[shape], shape]
    return rotations


def _match_pairs(
    points: Sequence[FloatArray], rotations: FloatArray | None, group: str, num_jobs: int
) -> tuple[FloatArray, FloatArray]:
    """Return ``R_i_j`` and the distance of all pairs; from the rotations of an earlier round, where there was one."""
    tasks = []
    for a, b in itertools.combinations(range(len(points)), 2):
        starts = axis_starts(points[a], points[b], group=group)
        if rotations is not None:
            starts = (rotations[a].T @ rotations[b])[None]
        tasks.append((f"{a} {b}", _PairTask(target=points[a], source=points[b], starts=starts)))
    relative = np.tile(np.eye(3), (len(points), len(points), 1, 1))
    distances = np.zeros((len(points), len(points)))
    for job in run_jobs(_match, tasks, num_jobs=num_jobs):
        if job.failure is not None:
            raise CollectionError(f"pair {job.key}: {job.failure}")
        a, b = (int(word) for word in job.key.split())
        relative[a, b], distances[a, b] = job.value
        relative[b, a], distances[b, a] = relative[a, b].T, distances[a, b]
    return relative, distances


def _match(task: _PairTask) -> tuple[FloatArray, float]:
    found = [closest_points(task.target, task.source, start) for start in task.starts]
    return min(found, key=lambda pose: pose[1])
