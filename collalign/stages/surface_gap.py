"""How far two surfaces are from each other at a pose: closest dense points with normals, beside energies."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.embedding.embedding import Samples

#: Dense points of each shape that are compared, of one shape the even and of the other the odd ones: otherwise copies
#: that share their samples would tell poses apart that look the same.
NUM_POINTS = 250
#: Weight of unit normals beside positions of root mean square radius 1.
NORMAL_WEIGHT = 0.3


def surface_gaps(target: Samples, source: Samples, rotations: FloatArray) -> FloatArray:
    """Return the gap of two shapes at each of some poses, shape (m,), in squared radii; see :func:`surface_gap`.

    Parameters
    ----------
    target, source : Samples
    rotations : ndarray, shape (m, d, d)
        ``R_target_source`` in the embedding; space comes first.
    """
    of_target, of_source = surface_points(target, first=0, every=1), surface_points(source, first=1, every=1)
    return read_only(np.array([surface_gap(of_target, of_source, rotation[:3, :3]) for rotation in rotations]))


def surface_gap(
    target: tuple[FloatArray, FloatArray], source: tuple[FloatArray, FloatArray], rotation: FloatArray
) -> float:
    """Return the mean squared distance of closest points, normals included where both have any, both ways."""
    gaps = point_gaps(target, source, rotation)
    return max(0.0, float(0.5 * (gaps.min(axis=0).mean() + gaps.min(axis=1).mean())))


def point_gaps(
    target: tuple[FloatArray, FloatArray], source: tuple[FloatArray, FloatArray], rotation: FloatArray
) -> FloatArray:
    """Return |t|^2 - 2 ts + |s|^2 of all points of two surfaces by one product; with normals where both have any."""
    turned, with_normals = [part @ rotation.T for part in source], len(target[1]) > 0 < len(source[1])
    to, of = (np.hstack([p, NORMAL_WEIGHT * n]) if with_normals else p for p, n in (target, turned))
    squares = [(features**2).sum(axis=1, keepdims=True) for features in (to, of)]
    ones = [np.ones_like(square) for square in squares]
    return np.hstack([-2.0 * to, squares[0], ones[0]]) @ np.hstack([of, ones[1], squares[1]]).T


def surface_points(samples: Samples, *, first: int, every: int = 2) -> tuple[FloatArray, FloatArray]:
    """Return every second dense point, in radii about the mean of all, and their normals.

    Without any, each ``every``-th sample of a surface, whose copies share its samples, and all points of a cloud.
    """
    if len(samples.dense_positions) < 2:
        step = 1 if samples.rim == "unknown" else every
        return _normalised(samples.positions)[first % step :: step], np.empty((0, 3))
    chosen = slice(first, 2 * NUM_POINTS, 2)
    return _normalised(samples.dense_positions)[chosen], samples.dense_normals[chosen]


def _normalised(points: FloatArray) -> FloatArray:
    """Return points of mean zero and root mean square radius 1."""
    centred = points - points.mean(axis=0)
    return np.asarray(centred / max(float(np.sqrt((centred**2).sum(axis=1).mean())), np.finfo(float).tiny))
