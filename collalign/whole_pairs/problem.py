"""What :mod:`pairwise` takes of prepared shapes: the problem of two of them, their match at a pose, dense points."""

from __future__ import annotations

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples
from pairwise.dense import DensePoints
from pairwise.problem import Problem


def pair_problem(target: Samples, source: Samples, group: str) -> Problem:
    """Return the Procrustes matching problem of two preprocessed shapes."""
    return Problem.from_user(
        target.coordinates,
        source.coordinates,
        group=group,
        rotation_pattern=target.block_sizes if len(target.block_sizes) > 1 else None,
        invariants=(target.invariants, source.invariants),
    )


def dense_points(samples: Samples) -> DensePoints:
    """Return a shape's dense samples for refinement, with normals where it has them."""
    normals = samples.dense_normals if len(samples.dense_normals) else None
    return DensePoints.from_user(samples.dense_positions, normals)


def matching_costs(target: Samples, source: Samples, rotation: FloatArray) -> FloatArray:
    """Return the costs of all matches at a rotation of space (3, 3), shape (k, k): source points are rows."""
    costs = scipy.spatial.distance.cdist(
        source.positions @ rotation.T, target.positions, "sqeuclidean"
    )
    costs += scipy.spatial.distance.cdist(source.invariants, target.invariants, "sqeuclidean")
    return np.asarray(costs)


def match_at_rotation(
    target: Samples, source: Samples, rotation: FloatArray
) -> tuple[IntArray, float]:
    """Return the best one-to-one match at a rotation of space, shape (k,), and its energy."""
    costs = matching_costs(target, source, rotation)
    rows, columns = scipy.optimize.linear_sum_assignment(costs)
    return columns.astype(np.int64), float(costs[rows, columns].sum())
