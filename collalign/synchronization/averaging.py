"""Averaging that outliers do not move: expectation-maximisation, and least absolute deviations.

Both take Gauss-Newton steps of weighted least squares, whose normal equations are one scalar graph Laplacian.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from collalign.synchronization.frames import cayley, relative
from collalign.synchronization.model import EdgeModel, squared_distances
from collalign.synchronization.spectral import DENSE_LIMIT
from data_tools.arrays import BoolArray, FloatArray, IntArray, sums_by_owner
from data_tools.rotations import chordal_angles
from data_tools.surface.laplacian import factor_symmetric
from data_tools.threads import one_blas_thread

#: Largest tangent step per axis, radians: beyond it the quadratic model means nothing.
MAX_STEP_RAD = 0.7

#: Conjugate gradients take so many steps at most, to this residual relative to the first.
MAX_CG_STEPS, CG_TOL = 200, 1e-3


def gauss_newton_step(
    frames: FloatArray,
    edges: IntArray,
    targets: FloatArray,
    weights: FloatArray,
    free: BoolArray,
) -> tuple[FloatArray, float]:
    """Move frames by one Gauss-Newton step of ``sum_e |P_i^T M_e P_j - w_e I|^2``, M_e the weighted measurement.

    With ``P_i exp(A_i)`` the antisymmetric parts satisfy ``w_e (A_i - A_j) = skew(P_i^T M_e P_j)``: a Laplacian
    system with d(d-1)/2 right-hand sides. Its fixed points are stationary points of the chordal objective.

    Parameters
    ----------
    frames : ndarray, shape (N, d, d)
    edges : ndarray of int, shape (E, 2)
    targets : ndarray, shape (E, d, d)
        ``M_e``: sums of measured rotations times their weights.
    weights : ndarray, shape (E,)
        Total weight of each pair.
    free : ndarray of bool, shape (N,)
        Shapes that may move; at least one may not.

    Returns
    -------
    frames : ndarray, shape (N, d, d)
    step : float
        Largest tangent entry, radians.
    """
    left, right = edges.T
    count, dim = len(frames), frames.shape[-1]
    rows, cols = np.triu_indices(dim, 1)
    aligned = np.swapaxes(frames[left], 1, 2) @ targets @ frames[right]
    pull = (aligned - np.swapaxes(aligned, 1, 2))[:, rows, cols] / 2.0
    force = sums_by_owner(pull, left, count) - sums_by_owner(pull, right, count)
    moves = np.zeros_like(force)
    moves[free] = _solve_laplacian(edges, weights, count, free, force[free])
    largest = float(np.abs(moves).max(initial=0.0))
    moves *= min(1.0, MAX_STEP_RAD / max(largest, MAX_STEP_RAD))
    skew = np.zeros((count, dim, dim))
    skew[:, rows, cols], skew[:, cols, rows] = moves, -moves
    return frames @ cayley(skew), largest


def _solve_laplacian(
    edges: IntArray, weights: FloatArray, count: int, free: BoolArray, force: FloatArray
) -> FloatArray:
    """Solve the weighted graph Laplacian of the free shapes: directly, or where it is large by conjugate gradients.

    These are stopped at ``CG_TOL`` (each step of Gauss-Newton starts anew), and replaced by a factorization where
    they are slow, as on grids, whose factors are sparse; those of graphs with random pairs are not.
    """
    left, right = edges.T
    degree = np.bincount(edges.ravel(), weights=np.repeat(weights, 2), minlength=count).astype(
        np.float64
    )
    degree += 1e-12 * max(float(degree.max(initial=0.0)), np.finfo(float).tiny)
    if count <= DENSE_LIMIT:
        laplacian = np.zeros((count, count))
        laplacian[left, right] = laplacian[right, left] = -weights
        laplacian[np.arange(count), np.arange(count)] = degree
        try:
            return scipy.linalg.cho_solve(
                scipy.linalg.cho_factor(laplacian[np.ix_(free, free)], check_finite=False), force
            )
        except scipy.linalg.LinAlgError:
            return np.asarray(
                np.linalg.lstsq(laplacian[np.ix_(free, free)], force, rcond=None)[0],
                dtype=np.float64,
            )
    inside = free[left] & free[right]
    number = np.cumsum(free) - 1
    ends, coupling = number[edges[inside]], weights[inside]
    matrix = _minus_couplings(degree[free], ends, coupling)
    tree = _heaviest_forest(ends, coupling, len(force))
    preconditioner = factor_symmetric(_minus_couplings(degree[free], ends[tree], coupling[tree]))
    solution = _conjugate_gradients(matrix, preconditioner.solve, force)
    return factor_symmetric(matrix).solve(force) if solution is None else solution


def _minus_couplings(
    degree: FloatArray, ends: IntArray, coupling: FloatArray
) -> scipy.sparse.csc_matrix:
    """Return the matrix with the degrees on its diagonal and minus the couplings of the pairs off it."""
    couplings = scipy.sparse.coo_matrix((coupling, tuple(ends.T)), shape=(len(degree), len(degree)))
    return (scipy.sparse.diags(degree) - couplings - couplings.T).tocsc()


def _heaviest_forest(ends: IntArray, coupling: FloatArray, count: int) -> IntArray:
    """Return which pairs make a spanning forest of greatest weight, ascending; of equal ones the first."""
    rank = np.empty(len(coupling))
    order = np.argsort(-coupling, kind="stable")
    rank[order] = np.arange(1.0, len(coupling) + 1.0)
    found = scipy.sparse.csgraph.minimum_spanning_tree(
        scipy.sparse.coo_matrix((rank, tuple(ends.T)), shape=(count, count)).tocsr()
    )
    return np.sort(order[found.data.astype(np.int64) - 1])


def _conjugate_gradients(
    matrix: scipy.sparse.csc_matrix,
    precondition: Callable[[FloatArray], FloatArray],
    force: FloatArray,
) -> FloatArray | None:
    """Return the solution for all columns by preconditioned conjugate gradients; None if they are too slow.

    The preconditioner is the matrix with the couplings of a spanning tree of greatest weight alone (Vaidya 1990, with
    the whole diagonal): it solves chains at once, and weights that differ by orders of magnitude do not matter to it.
    """
    solution, residual = np.zeros_like(force), force.copy()
    direction = precondition(residual)
    energy = (residual * direction).sum(axis=0)
    goal = CG_TOL**2 * np.maximum(energy, 1e-300)
    for _ in range(MAX_CG_STEPS):
        image = matrix @ direction
        step = energy / np.maximum((direction * image).sum(axis=0), 1e-300)
        solution += step * direction
        residual -= step * image
        preconditioned = precondition(residual)
        fresh = (residual * preconditioned).sum(axis=0)
        if (fresh <= goal).all():
            return solution
        direction = preconditioned + fresh / np.maximum(energy, 1e-300) * direction
        energy = fresh
    return None


#: No pair weighs less than this share of the heaviest: the equations keep full rank.
NEGLIGIBLE_SHARE = 1e-9

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
    floor = NEGLIGIBLE_SHARE * heaviest
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
