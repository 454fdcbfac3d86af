"""Robust averaging of several measurements of every relative rotation, each with its own trust."""

from __future__ import annotations

import numpy as np

from collalign.synchronization.problem.checks import relative
from collalign.synchronization.solvers.least_squares import gauss_newton_step
from collalign.synchronization.solvers.robust import LEAST_SHARE
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.rotations import chordal_angles
from data_tools.threads import one_blas_thread

#: Residuals below this count as this, degrees: finer than any two ways to measure a rotation agree.
SMALLEST_RESIDUAL_DEG = 3.0
#: Reweightings at most; they end with a step shorter than this, radians.
MAX_REWEIGHTINGS, SETTLED_RAD = 40, 1e-6


@one_blas_thread()
def average_frames(
    frames: FloatArray, edges: IntArray, measured: FloatArray, weights: FloatArray, free: BoolArray
) -> FloatArray:
    """Return the frames of least weighted absolute deviations from all measurements, next to some frames.

    Iteratively reweighted least squares of the sum of ``w_em |R_em - P_i P_j^T|`` (Hartley, Aftab and Trumpf 2011;
    Chatterjee and Govindu 2013), a deviation below :data:`SMALLEST_RESIDUAL_DEG` counting as its square.

    Parameters
    ----------
    frames : ndarray, shape (N, 3, 3)
        ``R_i_common``, where to start.
    edges : ndarray of int, shape (E, 2)
        Each unordered pair once.
    measured : ndarray, shape (E, m, 3, 3)
        ``R_i_j``, m measurements of each pair.
    weights : ndarray, shape (E, m)
        Their trust, 0 where a pair was not measured so.
    free : ndarray of bool, shape (N,)
        Shapes that may move; at least one of each part that the edges connect may not.
    """
    heaviest = float(weights.max(initial=0.0))
    if not heaviest > 0:
        return frames
    floor = LEAST_SHARE * heaviest
    for _ in range(MAX_REWEIGHTINGS):
        residuals = np.maximum(residuals_deg(frames, edges, measured), SMALLEST_RESIDUAL_DEG)
        current = weights * SMALLEST_RESIDUAL_DEG / residuals
        targets = np.einsum("em,emab->eab", current, measured) + floor * relative(frames, edges)
        frames, step = gauss_newton_step(frames, edges, targets, current.sum(axis=1) + floor, free)
        if step < SETTLED_RAD:
            break
    return frames


def residuals_deg(frames: FloatArray, edges: IntArray, measured: FloatArray) -> FloatArray:
    """Return how far every measurement is from some frames, shape (E, m), degrees."""
    return np.asarray(np.rad2deg(chordal_angles(measured, relative(frames, edges)[:, None])))
