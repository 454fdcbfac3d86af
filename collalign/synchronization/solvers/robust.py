"""Averaging that outliers do not move: expectation-maximisation, and least absolute deviations."""

from __future__ import annotations

import numpy as np

from collalign.synchronization.problem.checks import relative
from collalign.synchronization.problem.model import EdgeModel, squared_distances
from collalign.synchronization.solvers.least_squares import gauss_newton_step
from collalign.synchronization.solvers.spectral import spectral_frames
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.rotations import chordal_angles
from data_tools.threads import one_blas_thread

#: No pair weighs less than this share of the heaviest: the equations keep full rank.
LEAST_SHARE = 1e-9

#: Steps of the likelihood at most; they end with a step shorter than this, radians.
MAX_LIKELIHOOD_STEPS, LIKELIHOOD_STEP = 30, 1e-4

#: Every pair's lowest candidate keeps this share of the heaviest pair's weight: no shape is left without any.
UNTRUSTED_SHARE = 1e-7


def maximise_likelihood(
    model: EdgeModel,
    frames: FloatArray,
    free: BoolArray,
    *,
    estimate: bool = True,
) -> tuple[EdgeModel, FloatArray]:
    """Alternate the candidates' probabilities, the model's parameters and one Gauss-Newton step of the frames.

    Parameters
    ----------
    model : EdgeModel
    frames : ndarray, shape (N, d, d)
    free : ndarray of bool, shape (N,)
    estimate : bool
        Whether the parameters are estimated as well.
    """
    graph = model.graph
    for _ in range(MAX_LIKELIHOOD_STEPS):
        squared = squared_distances(graph, frames)
        if estimate:
            model = model.updated(squared)
        share = model.responsibilities(squared) / model.variances[:, None]
        weights = share.sum(axis=1)
        floor = UNTRUSTED_SHARE * weights.max(initial=0.0)
        targets = np.einsum("ek,ekab->eab", share, graph.candidates)
        targets += floor * graph.candidates[:, 0]
        frames, step = gauss_newton_step(frames, graph.edges, targets, weights + floor, free)
        if step < LIKELIHOOD_STEP:
            break
    return model, frames


def weighted_start(model: EdgeModel) -> FloatArray:
    """Return the eigenprojection (N, d, d) of the best candidates, weighted by the evidence of their energies."""
    graph = model.graph
    chance = np.exp(model.log_prior[np.arange(graph.num_edges), graph.best_choice])
    return spectral_frames(graph, graph.chosen(graph.best_choice), chance / model.variances)


#: Residuals below this count as this, degrees: finer than any two ways to measure a rotation agree.
SMALLEST_RESIDUAL_DEG = 3.0
#: Reweightings at most; they end with a step shorter than this, radians.
MAX_ROUNDS, SETTLED_RAD = 40, 1e-6


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
    for _ in range(MAX_ROUNDS):
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
