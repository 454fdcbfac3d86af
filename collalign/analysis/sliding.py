"""Semilandmarks slid along curves and surfaces, until each shape differs least from the mean."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from collalign.analysis.procrustes import (
    best_rotations,
    centroid_sizes,
    generalized_procrustes,
    unit_size,
)
from data_tools.arrays import FloatArray, IntArray, as_floats, read_only
from data_tools.checks import check_choice
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: What is least: the bending energy of the thin-plate spline from the mean, or the Procrustes distance from it.
Criterion: TypeAlias = Literal["bending", "procrustes"]
CRITERIA: tuple[Criterion, ...] = ("bending", "procrustes")
#: Rounds at most. Sliding has settled when the squared size of the sum of all shapes, over their number, changes by
#: no more than this. Both are the defaults of geomorph's ``gpagen``.
_MAX_SLIDES, _SLID_ENOUGH = 9, 1e-4
#: Nearest points through which the tangent plane of a semilandmark of a surface is laid, itself among them.
_NUM_AROUND = 5


@one_blas_thread()
def slide_semilandmarks(
    configurations: ArrayLike,
    sliders: ArrayLike,
    surfaces: Sequence[int] = (),
    *,
    criterion: Criterion = "bending",
) -> FloatArray:
    """Slide semilandmarks along curves and surfaces, each shape towards the mean of all.

    All shapes are superimposed. Semilandmarks of each move along their tangents to where the criterion is least. The
    shapes are rotated onto the mean again, and that is repeated with the new mean. Semilandmarks leave curved
    surfaces a little.

    This is what geomorph's ``gpagen`` does. It starts from shapes that are rotated onto the first one. Here they are
    rotated onto their mean first, so that the order of the shapes does not matter. Both agree to 1e-9 if the
    first one is the mean.

    Parameters
    ----------
    configurations : array_like, shape (N, l, 3)
        Complete, and of one handedness.
    sliders : array_like of int, shape (s, 3)
        Semilandmarks of curves: the point before, the one that slides, the point behind. The tangent goes from the
        first to the last.
    surfaces : sequence of int
        Semilandmarks of surfaces. The tangent plane is that of the nearest points of the configuration.
    criterion : {"bending", "procrustes"}

    Returns
    -------
    ndarray, shape (N, l, 3)
        In the coordinates of each configuration.

    Raises
    ------
    InputError
        If points are missing, there are fewer than two shapes, or a semilandmark is none of the points.
    OptionsError
        If the criterion is unknown.

    References
    ----------
    Bookstein, Landmark methods for forms without landmarks (1997). Gunz, Mitteroecker and Bookstein, Semilandmarks in
    three dimensions (2005). Rohlf's criterion of Procrustes distance: Perez, Bernal and Gonzalez (2006). Baken,
    Collyer, Kaliontzopoulou and Adams, geomorph v4.0 and gmShiny (2021).
    """
    check_choice("criterion", criterion, CRITERIA)
    points = np.array(as_floats(configurations, "configurations", shape=(None, None, 3)))
    rows = np.asarray(sliders, dtype=np.int64).reshape(-1, 3)
    if len(points) < 2:
        raise InputError(f"configurations: sliding needs at least two shapes, got {len(points)}")
    if not {*rows.ravel().tolist(), *surfaces} <= {*range(points.shape[1])}:
        raise InputError(f"sliders: a row is none of the {points.shape[1]} points")
    aligned = generalized_procrustes(points)
    rotations, sizes = best_rotations(aligned, unit_size(points)), centroid_sizes(points)
    mean, size = aligned.mean(axis=0), _squared_size(aligned)
    for _ in range(_MAX_SLIDES):
        energy = bending_matrix(mean) if criterion == "bending" else np.eye(len(mean))
        tangents = [_tangents(shape, rows, surfaces) for shape in aligned]
        moves = np.stack(
            [_moves(one, mean, energy, *own) for one, own in zip(aligned, tangents, strict=True)]
        )
        points += sizes[:, None, None] * (moves @ rotations)
        slid, before = aligned + moves, size
        turns, size = best_rotations(mean, slid), _squared_size(slid)
        aligned, rotations = slid @ np.swapaxes(turns, 1, 2), turns @ rotations
        mean = aligned.mean(axis=0)
        mean /= np.linalg.norm(mean - mean.mean(axis=0))
        if abs(size - before) <= _SLID_ENOUGH:
            break
    return read_only(points)


def _squared_size(shapes: FloatArray) -> float:
    """Return the squared size of the sum of shapes, over their number."""
    return float((shapes.sum(axis=0) ** 2).sum() / len(shapes))


def bending_matrix(reference: FloatArray) -> FloatArray:
    """Return the matrix whose quadratic form is the bending energy of displacements, shape (l, l).

    Parameters
    ----------
    reference : ndarray, shape (l, 3)
        Affine functions of it do not bend.

    References
    ----------
    Bookstein, Principal warps (1989); in space the kernel is the distance.
    """
    num = len(reference)
    affine = np.column_stack([np.ones(num), reference])
    system = np.zeros((num + 4, num + 4))
    system[:num, :num] = scipy.spatial.distance.cdist(reference, reference)
    system[:num, num:], system[num:, :num] = affine, affine.T
    return np.asarray(-np.linalg.pinv(system, hermitian=True)[:num, :num])


def _tangents(
    shape: FloatArray, sliders: IntArray, surfaces: Sequence[int]
) -> tuple[IntArray, FloatArray]:
    """Return which points move, and along which unit vectors, shapes (m,) and (m, 3)."""
    along = shape[sliders[:, 2]] - shape[sliders[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)
    chosen = np.asarray(surfaces, dtype=np.int64)
    near = (
        scipy.spatial.cKDTree(shape).query(shape[chosen], min(_NUM_AROUND, len(shape)))[1]
        if len(chosen)
        else None
    )
    planes = np.empty((0, 2, 3))
    if near is not None:
        around = shape[near] - shape[near].mean(axis=1, keepdims=True)
        planes = np.linalg.svd(around, full_matrices=False)[2][:, :2]
    rows = np.concatenate([sliders[:, 1], np.repeat(chosen, 2)])
    return rows, np.concatenate([along, planes.reshape(-1, 3)])


def _moves(
    shape: FloatArray, mean: FloatArray, energy: FloatArray, rows: IntArray, along: FloatArray
) -> FloatArray:
    """Return the movements along tangents at which the energy of the difference from the mean is least, (l, 3)."""
    moves = np.zeros_like(shape)
    if len(rows):
        system = energy[np.ix_(rows, rows)] * (along @ along.T)
        pull = ((energy @ (shape - mean))[rows] * along).sum(axis=1)
        lengths = np.linalg.lstsq(system, -pull, rcond=None)[0]
        np.add.at(moves, rows, lengths[:, None] * along)
    return moves
