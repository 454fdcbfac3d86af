"""Weighted least squares on the group: Gauss-Newton steps whose normal equations are one scalar graph Laplacian."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.sparse.linalg import SuperLU, splu

from collalign.synchronization.problem.checks import cayley
from collalign.synchronization.solvers.spectral import DENSE_LIMIT
from data_tools.arrays import BoolArray, FloatArray, IntArray

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
    force = np.stack(
        [
            np.bincount(left, weights=column, minlength=count)
            - np.bincount(right, weights=column, minlength=count)
            for column in pull.T
        ],
        axis=1,
    )
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
            return cho_solve(cho_factor(laplacian[np.ix_(free, free)], check_finite=False), force)
        except LinAlgError:
            return np.asarray(
                np.linalg.lstsq(laplacian[np.ix_(free, free)], force, rcond=None)[0],
                dtype=np.float64,
            )
    inside = free[left] & free[right]
    number = np.cumsum(free) - 1
    ends, coupling = number[edges[inside]], weights[inside]
    matrix = _minus_couplings(degree[free], ends, coupling)
    tree = _heaviest_forest(ends, coupling, len(force))
    preconditioner = _factor(_minus_couplings(degree[free], ends[tree], coupling[tree]))
    solution = _conjugate_gradients(matrix, preconditioner.solve, force)
    return _factor(matrix).solve(force) if solution is None else solution


def _minus_couplings(degree: FloatArray, ends: IntArray, coupling: FloatArray) -> csc_matrix:
    """Return the matrix with the degrees on its diagonal and minus the couplings of the pairs off it."""
    couplings = coo_matrix((coupling, tuple(ends.T)), shape=(len(degree), len(degree)))
    return (diags(degree) - couplings - couplings.T).tocsc()


def _heaviest_forest(ends: IntArray, coupling: FloatArray, count: int) -> IntArray:
    """Return which pairs make a spanning forest of greatest weight, ascending; of equal ones the first."""
    rank = np.empty(len(coupling))
    order = np.argsort(-coupling, kind="stable")
    rank[order] = np.arange(1.0, len(coupling) + 1.0)
    found = minimum_spanning_tree(coo_matrix((rank, tuple(ends.T)), shape=(count, count)).tocsr())
    return np.sort(order[found.data.astype(np.int64) - 1])


def _factor(matrix: csc_matrix) -> SuperLU:
    """Factor a symmetric positive definite matrix, without the pivoting that it does not need."""
    return splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


def _conjugate_gradients(
    matrix: csc_matrix, precondition: Callable[[FloatArray], FloatArray], force: FloatArray
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
