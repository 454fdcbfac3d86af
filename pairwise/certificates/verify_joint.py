"""Checks lower bounds of the energy of all arrangements of a collection, without the search that found them.

For one pose R_i per shape the energy is the sum over pairs of F_ij(R_i^T R_j). For any matrices L_ij (*tilts*) and
any symmetric Y_i, with S the matrix that has L_ij / 2 beside the diagonal and Y_i on it,

    sum_ij F_ij(R_i^T R_j)  =  sum_ij [F_ij - <L_ij, .>](R_i^T R_j)  +  tr X^T S X  -  tr Y,    X the stack of R_i^T,

because X_i X_j^T = R_i^T R_j. The first terms are at least their minima over all rotations, and tr X^T S X is at
least dN min(0, least eigenvalue of S). A minimum of F - <L, .> is bounded cell by cell as that of F is
(:mod:`pairwise.certificates.verify_cells`). Whatever the numbers are, what is returned holds.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.threads import one_blas_thread

_EPS = float(np.finfo(np.float64).eps)


def gram_matrix(edges: IntArray, tilts: FloatArray, diagonal: FloatArray) -> FloatArray:
    """Return S, shape (3N, 3N), of tilts (E, 3, 3) of distinct pairs (E, 2) and blocks Y (N, 3, 3)."""
    num, (left, right) = len(diagonal), edges.T
    matrix, every = np.zeros((num, 3, num, 3)), np.arange(num)
    matrix[left, :, right] = 0.5 * tilts
    matrix[right, :, left] = 0.5 * np.swapaxes(tilts, 1, 2)
    matrix[every, :, every] = 0.5 * (diagonal + np.swapaxes(diagonal, 1, 2))
    return matrix.reshape(3 * num, 3 * num)


@one_blas_thread()
def gram_bound(edges: IntArray, tilts: FloatArray, diagonal: FloatArray) -> float:
    """Return what ``sum <L_ij, R_i^T R_j>`` is at least, for all poses of N shapes.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    tilts : ndarray, shape (E, 3, 3)
    diagonal : ndarray, shape (N, 3, 3)
    """
    matrix = gram_matrix(edges, tilts, diagonal)
    least = float(np.linalg.eigvalsh(matrix)[0]) - _rounding(matrix)
    return len(matrix) * min(0.0, least) - float(np.trace(matrix)) - _rounding(matrix)


def _rounding(matrix: FloatArray) -> float:
    """Return more than rounding can have changed an eigenvalue or the trace by."""
    return 8.0 * len(matrix) * _EPS * float(np.linalg.norm(matrix))
