"""Generalised Procrustes analysis: translation, scale and mean from final maps (Gower 1975)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_indices, as_points, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread
from pairwise.problem.pattern import RotationPattern


@dataclass(frozen=True, kw_only=True, eq=False)
class Superimposition:
    """Similarity transforms that bring corresponding samples together.

    A sample x of shape i goes to ``scales[i] * x @ rotations[i].T + translations[i]``.

    Attributes
    ----------
    rotations : ndarray, shape (N, d, d)
    scales : ndarray, shape (N,)
        Their geometric mean is one.
    translations : ndarray, shape (N, d)
    mean : ndarray, shape (L, d)
        Mean position of each label; NaN where no shape has it. Centred on the origin.
    residuals : ndarray, shape (N,)
        Root mean square distance of each shape's samples to the mean, in units of the mean.
    iterations : int
    """

    rotations: FloatArray
    scales: FloatArray
    translations: FloatArray
    mean: FloatArray
    residuals: FloatArray
    iterations: int


@one_blas_thread()
def superimpose(
    samples: Sequence[ArrayLike],
    labels: Sequence[ArrayLike],
    rotations: ArrayLike,
    *,
    with_scale: bool = True,
    with_rotation: bool = False,
    max_iterations: int = 100,
    tol: float = 1e-12,
) -> Superimposition:
    """Alternate the mean of each label with the best similarity of each shape to the mean.

    Parameters
    ----------
    samples : sequence of array_like, shape (k_i, d)
        In the shapes' own coordinates.
    labels : sequence of array_like of int, shape (k_i,)
        Universe labels, -1 where a sample has none; see :func:`synchronize_maps`.
    rotations : array_like, shape (N, d, d)
        ``R_common_i``, kept unless ``with_rotation``.
    with_scale, with_rotation : bool
        Whether scales and rotations are estimated; a rotation keeps its determinant.
    max_iterations, tol
        Stops when the mean moves by less, relative to its size.

    Raises
    ------
    InputError
        If a shape has fewer than two labelled samples, or the arrays do not agree.
    """
    frames = np.array(rotations, dtype=np.float64)
    points, marks = _labelled(samples, labels, len(frames))
    total = max(int(v.max()) for v in marks) + 1
    state = _first_state(points, frames)
    mean, iterations = np.zeros((total, frames.shape[-1])), 0
    while iterations < max_iterations:
        iterations += 1
        fresh = _mean(points, marks, state, total)
        state = _fitted(points, marks, fresh, state, with_scale=with_scale, with_rotation=with_rotation)
        change, size = np.nansum((fresh - mean) ** 2), np.nansum(fresh**2)
        mean = fresh
        if change <= tol**2 * size:
            break
    rotation, scales, shifts = state
    return Superimposition(
        rotations=read_only(rotation),
        scales=read_only(scales),
        translations=read_only(shifts),
        mean=read_only(mean),
        residuals=read_only(_residuals(points, marks, mean, state)),
        iterations=iterations,
    )


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


_State = tuple[FloatArray, FloatArray, FloatArray]


def _first_state(points: list[FloatArray], frames: FloatArray) -> _State:
    """Centre every shape on its labelled samples, at scale one."""
    shifts = np.stack([-r @ x.mean(axis=0) for x, r in zip(points, frames, strict=True)])
    return frames, np.ones(len(points)), shifts


def _mean(points: list[FloatArray], marks: list[IntArray], state: _State, total: int) -> FloatArray:
    """Return the mean of each label, centred on the origin."""
    rotations, scales, shifts = state
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
    state: _State,
    *,
    with_scale: bool,
    with_rotation: bool,
) -> _State:
    """Return the best similarity of every shape to the mean; scales to geometric mean one."""
    rotations, scales, shifts = (part.copy() for part in state)
    special = RotationPattern.from_user(None, mean.shape[1], "SO")
    for i, (x, v) in enumerate(zip(points, marks, strict=True)):
        goal = mean[v] - mean[v].mean(axis=0)
        own = x - x.mean(axis=0)
        if with_rotation:
            mirror = np.ones(x.shape[1])
            mirror[0] = np.sign(np.linalg.det(rotations[i]))
            rotations[i] = special.project(goal.T @ own * mirror) * mirror
        if with_scale:
            scales[i] = np.sum(goal * (own @ rotations[i].T)) / max(float(np.sum(own**2)), 1e-300)
    if with_scale:
        scales = np.maximum(scales, 1e-12)
        scales /= np.exp(np.mean(np.log(scales)))
    for i, (x, v) in enumerate(zip(points, marks, strict=True)):
        shifts[i] = mean[v].mean(axis=0) - scales[i] * rotations[i] @ x.mean(axis=0)
    return rotations, scales, shifts


def _residuals(points: list[FloatArray], marks: list[IntArray], mean: FloatArray, state: _State) -> FloatArray:
    """Return the root mean square distance of each shape's samples to the mean, shape (N,)."""
    apart = [s * x @ r.T + t - mean[v] for x, v, r, s, t in zip(points, marks, *state, strict=True)]
    return np.array([np.sqrt(np.mean(np.sum(d**2, axis=1))) for d in apart])
