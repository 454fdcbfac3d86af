"""How far two surfaces are from each other at a pose: closest dense points with normals, in addition to energies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples

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
    each = (
        0.5 * (gaps.min(axis=0).mean() + gaps.min(axis=1).mean())
        for gaps in point_gaps(target, source, rotations)
    )
    return np.maximum(np.fromiter(each, dtype=np.float64, count=len(rotations)), 0.0)


def point_gaps(
    target: tuple[FloatArray, FloatArray],
    source: tuple[FloatArray, FloatArray],
    rotations: FloatArray,
) -> Iterator[FloatArray]:
    """Yield |t|^2 - 2 ts + |s|^2, shape (n, k), of points (n, 3), (k, 3) and normals at each rotation (p, 3, 3).

    Each is written over the one before.
    """
    num = 2 if len(target[1]) > 0 < len(source[1]) else 1
    to, of = (np.hstack([p, NORMAL_WEIGHT * n][:num]) for p, n in (target, source))
    left = np.column_stack([-2.0 * to, (to**2).sum(axis=1), np.ones(len(to))])
    right = np.vstack([of.T, np.ones(len(of)), (of**2).sum(axis=1)])
    columns, gaps = of.T.reshape(num, 3, -1), np.empty((len(to), len(of)))
    for rotation in rotations:
        right[:-2] = (rotation @ columns).reshape(3 * num, -1)
        yield np.matmul(left, right, out=gaps)


def surface_points(
    samples: Samples, *, first: int, every: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Return every second dense point, in radii about the mean of all, and their normals, both (n, 3).

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
    return np.asarray(
        centred / max(float(np.sqrt((centred**2).sum(axis=1).mean())), np.finfo(float).tiny)
    )
