"""What :mod:`pairwise` takes of prepared shapes: the problem of two of them, and dense points of one."""

from __future__ import annotations

from data_tools.embedding.embedding import Samples
from pairwise.dense.points import DensePoints
from pairwise.problem.problem import Problem


def pair_problem(target: Samples, source: Samples, group: str) -> Problem:
    """Return the Procrustes matching problem of two preprocessed shapes."""
    return Problem.from_user(
        target.coordinates,
        source.coordinates,
        group=group,
        rotation_pattern=target.block_sizes if len(target.block_sizes) > 1 else None,
        invariants=(target.invariants, source.invariants),
    )


def dense_points(samples: Samples, *, invariants: bool = True) -> DensePoints:
    """Return a shape's dense samples for refinement, with normals where it has them."""
    return DensePoints.from_user(
        samples.dense_positions,
        samples.dense_normals if len(samples.dense_normals) else None,
        samples.dense_invariants if invariants else None,
    )
