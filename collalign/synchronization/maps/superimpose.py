"""Scales and shifts from final maps and rotations: generalised Procrustes analysis (Gower 1975) without turning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_indices, as_points
from data_tools.errors import InputError
from data_tools.poses import Similarity
from data_tools.threads import one_blas_thread

#: Rounds of means and fits, at most; they end when the mean moves by less than this, relative to its size.
MAX_ROUNDS, MEAN_TOL = 100, 1e-12


@one_blas_thread()
def superimpose(
    samples: Sequence[ArrayLike],
    labels: Sequence[ArrayLike],
    rotations: ArrayLike,
    *,
    with_scale: bool = True,
) -> Similarity:
    """Alternate the mean of each label with the best scale and shift of each shape to the mean.

    Parameters
    ----------
    samples : sequence of array_like, shape (k_i, d)
        In the shapes' own coordinates.
    labels : sequence of array_like of int, shape (k_i,)
        Universe labels, -1 where a sample has none; see :func:`synchronize_maps`.
    rotations : array_like, shape (N, d, d)
        ``R_common_i``; they are kept. :func:`collalign.analysis.procrustes.generalized_procrustes` turns as well.
    with_scale : bool
        Whether scales are estimated.

    Returns
    -------
    Similarity
        One pose a shape, at the rotations given; the geometric mean of the scales is one.

    Raises
    ------
    InputError
        If a shape has fewer than two labelled samples, or the arrays do not agree.
    """
    frames = np.array(rotations, dtype=np.float64)
    points, marks = _labelled(samples, labels, len(frames))
    total = max(int(v.max()) for v in marks) + 1
    scales = np.ones(len(points))
    shifts = np.stack([-r @ x.mean(axis=0) for x, r in zip(points, frames, strict=True)])
    mean = np.zeros((total, frames.shape[-1]))
    for _ in range(MAX_ROUNDS):
        fresh = _mean(points, marks, frames, scales, shifts, total)
        scales, shifts = _fitted(points, marks, fresh, frames, scales, with_scale=with_scale)
        change, size = np.nansum((fresh - mean) ** 2), np.nansum(fresh**2)
        mean = fresh
        if change <= MEAN_TOL**2 * size:
            break
    return Similarity(rotation=frames, scale=scales, shift=shifts)


def _labelled(
    samples: Sequence[ArrayLike], labels: Sequence[ArrayLike], count: int
) -> tuple[list[FloatArray], list[IntArray]]:
    """Check samples and labels, and return those samples that have a label, with their labels."""
    clouds = [as_points(x, f"samples[{i}]") for i, x in enumerate(samples)]
    names = [as_indices(v, f"labels[{i}]", upper=np.iinfo(np.int64).max, lower=-1) for i, v in enumerate(labels)]
    if len(clouds) != count or [len(x) for x in clouds] != [len(v) for v in names]:
        raise InputError("samples, labels and rotations must be of the same shapes and samples")
    kept = [np.flatnonzero(v >= 0) for v in names]
    if min(len(k) for k in kept) < 2:
        raise InputError("labels: every shape needs two labelled samples or more")
    return [x[k] for x, k in zip(clouds, kept, strict=True)], [v[k] for v, k in zip(names, kept, strict=True)]


def _mean(
    points: list[FloatArray],
    marks: list[IntArray],
    rotations: FloatArray,
    scales: FloatArray,
    shifts: FloatArray,
    total: int,
) -> FloatArray:
    """Return the mean of each label, centred on the origin."""
    sums, count = np.zeros((total, rotations.shape[-1])), np.zeros(total)
    for x, v, r, s, t in zip(points, marks, rotations, scales, shifts, strict=True):
        np.add.at(sums, v, s * x @ r.T + t)
        np.add.at(count, v, 1.0)
    mean = sums / np.where(count > 0, count, np.nan)[:, None]
    return np.asarray(mean - np.nanmean(mean, axis=0), dtype=np.float64)


def _fitted(
    points: list[FloatArray],
    marks: list[IntArray],
    mean: FloatArray,
    rotations: FloatArray,
    scales: FloatArray,
    *,
    with_scale: bool,
) -> tuple[FloatArray, FloatArray]:
    """Return the best scale and shift of every shape to the mean; scales to geometric mean one."""
    if with_scale:
        scales = np.empty(len(points))
        for i, (x, v) in enumerate(zip(points, marks, strict=True)):
            goal, own = mean[v] - mean[v].mean(axis=0), x - x.mean(axis=0)
            scales[i] = np.sum(goal * (own @ rotations[i].T)) / max(float(np.sum(own**2)), 1e-300)
        scales = np.maximum(scales, 1e-12)
        scales /= np.exp(np.mean(np.log(scales)))
    centres = zip(points, marks, rotations, scales, strict=True)
    return scales, np.stack([mean[v].mean(axis=0) - s * r @ x.mean(axis=0) for x, v, r, s in centres])
