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


@one_blas_thread()
def largest_turns(
    edges: IntArray, tilts: FloatArray, diagonal: FloatArray, frames: FloatArray, gap: float
) -> FloatArray:
    """Bound the angles by which poses of a total energy at most that of the given ones can differ from these.

    With D the stack of R_i^T at i and -R_j^T at j, and W_i = (R_i^T)^T X_i what turns shape i, W_i - W_j = D^T X, so
    |W_i - W_j|^2 <= tr X^T S X times the largest eigenvalue of D^T S^-1 D where S is positive definite, and it is
    8 sin^2(angle / 2), and at least 4 where just one of them is mirrored.

    Parameters
    ----------
    edges, tilts, diagonal
        As for :func:`gram_bound`.
    frames : ndarray, shape (N, 3, 3)
        R_i.
    gap : float
        The energy of these poses less the sum of the pairs' bounds: then tr X^T S X - tr Y is at most that.

    Returns
    -------
    ndarray, shape (N,)
        For each shape the median over the others, in radians; pi where its pose, or its mirror image, is left free.
    """
    matrix, num = gram_matrix(edges, tilts, diagonal), len(frames)
    shift = max(0.0, _rounding(matrix) - float(np.linalg.eigvalsh(matrix)[0]))
    slack = gap + float(np.trace(matrix)) + _rounding(matrix)
    least = np.full((num, num), np.inf)
    for share in _SHIFTS:
        more = shift + share * max(slack, 0.0) / len(matrix)
        if more > 0.0:
            resistances = _resistances(matrix + more * np.eye(len(matrix)), frames)
            least = np.minimum(least, (slack + len(matrix) * more) * resistances)
    turns = np.where(least < 4.0, 2.0 * np.arcsin(np.sqrt(np.clip(least / 8.0, 0.0, 1.0))), np.pi)
    others = turns[~np.eye(num, dtype=bool)].reshape(num, num - 1)
    return np.asarray(np.median(others, axis=1))


#: By what share of the slack S is raised in all, to be inverted: the least result of these counts.
_SHIFTS = (0.01, 0.1, 1.0)


def _resistances(matrix: FloatArray, frames: FloatArray) -> FloatArray:
    """Return the largest eigenvalue of D^T S^-1 D for all pairs of shapes, (N, N)."""
    num = len(frames)
    blocks = np.linalg.inv(matrix).reshape(num, 3, num, 3)
    turned = np.einsum("iab,ibjc,jdc->ijad", frames, blocks, frames, optimize=True)
    own = turned[np.arange(num), np.arange(num)]
    both = own[:, None] + own[None] - turned - np.swapaxes(turned, 2, 3)
    return np.asarray(np.linalg.eigvalsh(both)[..., -1] * (1.0 + 1e-9))


def _rounding(matrix: FloatArray) -> float:
    """Return more than rounding can have changed an eigenvalue or the trace by."""
    return 8.0 * len(matrix) * _EPS * float(np.linalg.norm(matrix))
