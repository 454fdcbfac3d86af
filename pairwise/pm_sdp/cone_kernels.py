"""The cones of all source points, compiled by Numba: points inside them, and how far a step may go.

Blocks are small (nine variables in three dimensions) and many, so that calls cost NumPy more than the arithmetic.
How far a step may go is asked point after point: most keep their margin at the longest step that the points before
them allow, which one Cholesky factorisation shows; only where one does not, bisection finds what it allows.
"""

from __future__ import annotations

import numba
import numpy as np

from data_tools.arrays import BoolArray, FloatArray

#: Bisection ends when the interval is this share of its upper end.
_PRECISION = 1.0 / 256.0


@numba.njit(cache=True)
def _is_positive(matrix: FloatArray) -> bool:
    """Replace the upper triangle of a symmetric matrix by its Cholesky factor; False where it is not positive."""
    size = len(matrix)
    for a in range(size):
        pivot = matrix[a, a]
        if not (pivot > 0.0 and pivot < np.inf):
            return False
        root = 1.0 / np.sqrt(pivot)
        for b in range(a, size):
            matrix[a, b] *= root
        for c in range(a + 1, size):
            factor = matrix[a, c]
            for b in range(c, size):
                matrix[c, b] -= factor * matrix[a, b]
    return True


@numba.njit(cache=True)
def invert_upper(factor: FloatArray, inverse: FloatArray) -> None:
    """Write the inverse of a factor's upper triangle, transposed: the lower inverse of the lower factor."""
    size = len(factor)
    inverse[:] = 0.0
    for a in range(size):
        inverse[a, a] = 1.0
        for c in range(a):
            slope = factor[c, a]
            for b in range(c + 1):
                inverse[a, b] -= slope * inverse[c, b]
        scale = 1.0 / factor[a, a]
        for b in range(a + 1):
            inverse[a, b] *= scale


@numba.njit(cache=True)
def are_positive(blocks: FloatArray) -> bool:
    """Return whether all blocks (q, a, a) are positive definite."""
    inside = True
    for block in blocks:
        inside &= _is_positive(block.copy())
    return inside


@numba.njit(cache=True)
def conditional_moments(
    x: FloatArray, B: FloatArray, C: FloatArray, valid: BoolArray
) -> tuple[FloatArray, FloatArray, bool]:
    """Return ``B / x`` (k, c, s), ``G = C - sum B B^T / x`` (k, s, s), and whether every G is positive definite."""
    num, _, s = B.shape
    mean, G = np.zeros(B.shape), np.empty((num, s, s))
    scatter = np.empty((s, s))
    for j in range(num):
        for i in range(x.shape[1]):
            if valid[j, i]:
                inverse = 1.0 / x[j, i]
                for a in range(s):
                    mean[j, i, a] = B[j, i, a] * inverse
        np.dot(B[j].T, mean[j], scatter)
        for a in range(s):
            for b in range(s):
                G[j, a, b] = C[a, b] - 0.5 * (scatter[a, b] + scatter[b, a])
        scatter[:] = G[j]
        if not _is_positive(scatter):
            return mean, G, False
    return mean, G, True


@numba.njit(cache=True)
def dual_blocks(
    F: FloatArray,
    u: FloatArray,
    vectors: FloatArray,
    linear: FloatArray,
    valid: BoolArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, bool]:
    """Return factor, inverse, w, mean and s of a :class:`pairwise.pm_sdp.variables.DualPoint`, and whether it is one.

    Parameters
    ----------
    F, u : ndarray, shapes (k, s, s) and (k, s)
    vectors : ndarray, shape (k, c, s)
    linear : ndarray, shape (k, c)
        ``cost - alpha - beta``.
    valid : ndarray of bool, shape (k, c)
    """
    num, num_matches, dim = vectors.shape
    factor, inverse = np.zeros(F.shape), np.empty(F.shape)
    w, mean = np.zeros(vectors.shape), np.empty(vectors.shape)
    s = np.ones(linear.shape)
    work, root, whitened = np.empty((dim, dim)), np.empty((dim, dim)), np.empty((num_matches, dim))
    for j in range(num):
        work[:] = F[j]
        if not _is_positive(work):
            return factor, inverse, w, mean, s, False
        for a in range(dim):
            for b in range(a, dim):
                factor[j, b, a] = work[a, b]
        invert_upper(work, root)
        np.dot(root.T, root, inverse[j])
        for i in range(num_matches):
            if valid[j, i]:
                for a in range(dim):
                    w[j, i, a] = vectors[j, i, a] - u[j, a]
        np.dot(w[j], root.T, whitened)
        np.dot(whitened, root, mean[j])
        for i in range(num_matches):
            if valid[j, i]:
                s[j, i] = linear[j, i] - (whitened[i] * whitened[i]).sum()
                if not s[j, i] > 0.0:
                    return factor, inverse, w, mean, s, False
    return factor, inverse, w, mean, s, True


@numba.njit(cache=True)
def longest_block_step(blocks: FloatArray, changes: FloatArray, least: float, size: float) -> float:
    """Return the largest step of at most ``size`` at which every block keeps the share ``least`` of itself.

    Parameters
    ----------
    blocks, changes : ndarray, shape (k, s, s)
        Positive definite blocks, and how they change.
    least : float
        In [0, 1): ``block + step * change - least * block`` stays positive definite.
    size : float
    """
    dim = blocks.shape[-1]
    work = np.empty((dim, dim))
    for j in range(len(blocks)):
        low, high, trial = 0.0, size, size
        while True:
            for a in range(dim):
                for b in range(a, dim):
                    work[a, b] = (1.0 - least) * blocks[j, a, b] + trial * changes[j, a, b]
            if _is_positive(work):
                low = trial
            else:
                high = trial
            if high - low <= _PRECISION * high:
                break
            trial = 0.5 * (low + high)
        size = low
    return size


@numba.njit(cache=True)
def longest_primal_step(
    point: tuple[FloatArray, ...], valid: BoolArray, step: tuple[FloatArray, ...], least: float, size: float
) -> float:
    """Return the largest step of at most ``size`` at which every G keeps the share ``least`` of itself.

    Parameters
    ----------
    point : tuple of ndarray
        The x, B, C and G of a :class:`pairwise.pm_sdp.variables.PrimalPoint`.
    valid : ndarray of bool, shape (k, c)
    step : tuple of ndarray
        How x, B and C change; ``x + size * dx`` is positive.
    least : float
        In [0, 1).
    size : float
    """
    (x, B, C, G), (dx, dB, dC) = point, step
    num_matches, s = B.shape[1:]
    moved, weighted, scatter = np.empty((num_matches, s)), np.empty((num_matches, s)), np.empty((s, s))
    for j in range(len(x)):
        low, high, trial = 0.0, size, size
        while True:
            for i in range(num_matches):
                inverse = 1.0 / (x[j, i] + trial * dx[j, i]) if valid[j, i] else 0.0
                for a in range(s):
                    moved[i, a] = B[j, i, a] + trial * dB[j, i, a]
                    weighted[i, a] = inverse * moved[i, a]
            np.dot(moved.T, weighted, scatter)
            for a in range(s):
                for b in range(a, s):
                    scatter[a, b] = C[a, b] + trial * dC[a, b] - least * G[j, a, b] - scatter[a, b]
            if _is_positive(scatter):
                low = trial
            else:
                high = trial
            if high - low <= _PRECISION * high:
                break
            trial = 0.5 * (low + high)
        size = low
    return size


@numba.njit(cache=True)
def longest_dual_step(
    point: tuple[FloatArray, FloatArray],
    valid: BoolArray,
    step: tuple[FloatArray, FloatArray, FloatArray],
    least: float,
    size: float,
) -> float:
    """Return the largest step of at most ``size`` at which every F and s keeps the share ``least`` of itself.

    A slack changes by ``size ds - size^2 bend^T (F + size dF)^-1 bend``.

    Parameters
    ----------
    point : tuple of ndarray
        The F and s of a :class:`pairwise.pm_sdp.variables.DualPoint`.
    valid : ndarray of bool, shape (k, c)
    step : tuple of ndarray
        The F, bend and ds of a :class:`pairwise.pm_sdp.variables.Direction`.
    least : float
        In [0, 1).
    size : float
    """
    (F, s), (dF, bend, ds) = point, step
    num, num_matches, dim = bend.shape
    work, root, whitened = np.empty((dim, dim)), np.empty((dim, dim)), np.empty((num_matches, dim))
    size = longest_block_step(F, dF, least, size)
    for j in range(num):
        low, high, trial = 0.0, size, size
        while True:
            for a in range(dim):
                for b in range(a, dim):
                    work[a, b] = F[j, a, b] + trial * dF[j, a, b]
            keeps = _is_positive(work)
            if keeps:
                invert_upper(work, root)
                np.dot(bend[j], root.T, whitened)
                for i in range(num_matches):
                    if valid[j, i]:
                        change = ds[j, i] - trial * (whitened[i] * whitened[i]).sum()
                        keeps &= (1.0 - least) * s[j, i] + trial * change >= 0.0
            if keeps:
                low = trial
            else:
                high = trial
            if high - low <= _PRECISION * high:
                break
            trial = 0.5 * (low + high)
        size = low
    return size
