"""What the Newton system does for every source point by itself, compiled by Numba.

Blocks are small (nine variables in three dimensions) and many, so that calls cost NumPy more than the arithmetic.
The notation is that of :mod:`pairwise.pm_sdp.newton`, :mod:`pairwise.pm_sdp.newton_blocks` and
:mod:`pairwise.pm_sdp.step_targets`.
"""

from __future__ import annotations

import numba
import numpy as np

from data_tools.arrays import FloatArray, IntArray
from pairwise.pm_sdp.cone_kernels import invert_upper

#: Floor of eigenvalues that are positive but for rounding errors.
_TINY = float(np.finfo(np.float64).tiny) ** 0.5

#: R stands beside the diagonal of the moment matrix: its coordinates are scaled by the root of two.
_ROOT_HALF = float(np.sqrt(0.5))


@numba.njit(cache=True)
def diagonalise(
    x: FloatArray, B: FloatArray, mean: FloatArray, G: FloatArray, factor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return T (k, s+1, s+1) and lambda (k, s) with ``T H T^T = diag(1, lambda)`` and ``T E T^T = diag(0, 1)``.

    Parameters
    ----------
    x, B, mean, G : ndarray, shapes (k, c), (k, c, s), (k, c, s), (k, s, s)
        Of the primal point.
    factor : ndarray, shape (k, s, s)
        Lower Cholesky factor of each F.
    """
    num, num_matches, s = B.shape
    T, eigenvalues = np.zeros((num, s + 1, s + 1)), np.empty((num, s))
    centred, spread, half = np.empty((num_matches, s)), np.empty((s, s)), np.empty((s, s))
    for j in range(num):
        total = x[j].sum()
        first = np.zeros(s)
        for i in range(num_matches):
            for a in range(s):
                first[a] += B[j, i, a]
        for i in range(num_matches):
            root = np.sqrt(x[j, i])
            for a in range(s):
                centred[i, a] = root * (mean[j, i, a] - first[a] / total)
        np.dot(centred.T, centred, spread)
        spread += 0.5 * G[j]
        np.dot(spread, factor[j], half)
        np.dot(factor[j].T, half, spread)
        values, vectors = np.linalg.eigh(spread)
        np.dot(vectors.T, np.ascontiguousarray(factor[j].T), half)
        T[j, 0, 0] = 1.0 / np.sqrt(total)
        for a in range(s):
            eigenvalues[j, a] = max(values[a], _TINY)
            for b in range(s):
                T[j, a + 1, b + 1] = half[a, b]
                T[j, a + 1, 0] -= half[a, b] * first[b] / total
    return T, eigenvalues


@numba.njit(cache=True)
def inverse_factors(matrices: FloatArray) -> FloatArray:
    """Return the inverses (k, m, m) of the Cholesky factors of positive definite matrices; not finite elsewhere."""
    inverses = np.empty(matrices.shape)
    for j in range(len(matrices)):
        invert_upper(np.linalg.cholesky(matrices[j]).T, inverses[j])
    return inverses


@numba.njit(cache=True)
def solve_blocks(
    blocks: tuple[FloatArray, ...],
    coordinates: tuple[IntArray, IntArray, FloatArray],
    rhs: FloatArray,
    push: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return dx (k, c) and Delta (k, s+1, s+1); see :class:`pairwise.pm_sdp.newton_blocks.LocalBlocks`."""
    T, features, root, root_weights, ones, share, inverse_total = blocks
    rows, cols, scale = coordinates
    num, num_matches, m = features.shape
    size = T.shape[1]
    dx, local = np.empty((num, num_matches)), np.empty((num, size, size))
    half, full = np.empty((size, size)), np.zeros((size, size))
    inner = np.empty(m)
    for j in range(num):
        np.dot(T[j], rhs[j], half)
        np.dot(half, T[j].T, full)
        for e in range(m):
            inner[e] = full[rows[e], cols[e]] * scale[e] * root_weights[j, e]
        pushed = (push[j] - np.dot(features[j], inner)) * ones[j]
        reaction = np.dot(root[j].T, np.dot(root[j], pushed))
        excess = reaction.sum() + rhs[j, 0, 0]
        dx[j] = reaction - share[j] * excess
        inner += np.dot(features[j].T, dx[j])
        full[0, 0] = 0.0
        for e in range(m):
            value = inner[e] * root_weights[j, e] / scale[e]
            full[rows[e], cols[e]] = value
            full[cols[e], rows[e]] = value
        np.dot(T[j].T, full, half)
        np.dot(half, T[j], full)
        for a in range(size):
            for b in range(size):
                local[j, a, b] = 0.5 * (full[a, b] + full[b, a])
        local[j, 0, 0] += excess / inverse_total[j]
    return dx, local


@numba.njit(cache=True)
def step_of_points(
    x: FloatArray,
    B: FloatArray,
    mean: FloatArray,
    inverse: FloatArray,
    ratio: FloatArray,
    dx: FloatArray,
    local: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return dB, dF, du, bend, and what F and u add to ds; see :class:`pairwise.pm_sdp.variables.Direction`.

    Parameters
    ----------
    x, B : ndarray, shapes (k, c) and (k, c, s)
        Of the primal point.
    mean, inverse : ndarray, shapes (k, c, s) and (k, s, s)
        Of the dual point.
    ratio : ndarray, shape (k, c, s)
        Of the targets.
    dx, local : ndarray, shapes (k, c) and (k, s+1, s+1)
        Of :func:`solve_blocks`.
    """
    num, num_matches, s = B.shape
    dB, bend, ds = np.empty(B.shape), np.empty(B.shape), np.empty(x.shape)
    dF, du = np.ascontiguousarray(local[:, 1:, 1:]), np.ascontiguousarray(local[:, 1:, 0])
    pull = np.empty((num_matches, s))
    for j in range(num):
        np.dot(mean[j], dF[j], bend[j])
        np.dot(B[j], dF[j], pull)
        for i in range(num_matches):
            ds[j, i] = 0.0
            for a in range(s):
                pull[i, a] += x[j, i] * du[j, a] - ratio[j, i, a]
                ds[j, i] += (bend[j, i, a] + 2.0 * du[j, a]) * mean[j, i, a]
                bend[j, i, a] = -du[j, a] - bend[j, i, a]
        np.dot(pull, inverse[j], dB[j])
        for i in range(num_matches):
            for a in range(s):
                dB[j, i, a] = dx[j, i] * mean[j, i, a] - dB[j, i, a]
    return dB, dF, du, bend, ds


@numba.njit(cache=True)
def second_order_terms(
    x: FloatArray, mean: FloatArray, inverse: FloatArray, step: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what a step leaves of ratio, products and Gram matrices; see :func:`pairwise.pm_sdp.step_targets.aim`.

    Parameters
    ----------
    x, mean : ndarray, shapes (k, c) and (k, c, s)
        Of the primal point, x one where padded.
    inverse : ndarray, shape (k, s, s)
        Of the dual point.
    step : tuple of ndarray
        Its dx, dB, dC, dF, du, bend and ds.
    """
    dx, dB, dC, dF, du, bend, ds = step
    num, num_matches, s = dB.shape
    ratio, products, gram = np.empty(dB.shape), np.empty(dx.shape), np.empty(dF.shape)
    curved, bent = np.empty((num_matches, s)), np.empty((num_matches, s))
    change, linear, half = np.empty((s, s)), np.empty((s, s)), np.empty((s, s))
    for j in range(num):
        np.dot(dB[j], dF[j], ratio[j])
        np.dot(bend[j], inverse[j], curved)
        for i in range(num_matches):
            total = 0.0
            for a in range(s):
                ratio[j, i, a] += dx[j, i] * du[j, a]
                total += curved[i, a] * bend[j, i, a]
                bent[i, a] = dB[j, i, a] - mean[j, i, a] * dx[j, i]
                curved[i, a] = bent[i, a] / x[j, i]
            products[j, i] = x[j, i] * total - dx[j, i] * ds[j, i]
        np.dot(curved.T, bent, gram[j])
        for i in range(num_matches):
            for a in range(s):
                bent[i, a] += dB[j, i, a]
        np.dot(bent.T, mean[j], linear)
        for a in range(s):
            for b in range(s):
                change[a, b] = dC[a, b] - 0.5 * (linear[a, b] + linear[b, a])
        np.dot(dF[j], change, half)
        np.dot(inverse[j], half, change)
        for a in range(s):
            for b in range(s):
                gram[j, a, b] -= 0.5 * (change[a, b] + change[b, a])
    return ratio, products, gram


@numba.njit(cache=True)
def first_order_terms(
    primal: tuple[FloatArray, ...], dual: tuple[FloatArray, ...], mu: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ratio, products and the Gram matrices that lead to mu; see :func:`pairwise.pm_sdp.step_targets.aim`.

    Parameters
    ----------
    primal, dual : tuple of ndarray
        The points' x, B and G; w, s, F and the inverses of F.
    mu : float
    """
    (x, B, G), (w, s, F, inverse) = primal, dual
    num, num_matches, dim = B.shape
    ratio, products, gram = np.empty(B.shape), np.empty(x.shape), np.empty(G.shape)
    for j in range(num):
        np.dot(B[j], F[j], ratio[j])
        for i in range(num_matches):
            products[j, i] = mu - x[j, i] * s[j, i]
            for a in range(dim):
                ratio[j, i, a] = x[j, i] * w[j, i, a] - ratio[j, i, a]
        for a in range(dim):
            for b in range(dim):
                gram[j, a, b] = mu * inverse[j, a, b] - G[j, a, b]
    return ratio, products, gram


@numba.njit(cache=True)
def moment_targets(
    x: FloatArray,
    B: FloatArray,
    mean: FloatArray,
    R: FloatArray,
    inverse: FloatArray,
    ratio: FloatArray,
    gram: FloatArray,
) -> FloatArray:
    """Return the moment equation's right hand side (k, s+1, s+1), what the sums of x and B still miss included.

    Parameters
    ----------
    x, B, mean, R
        Of the primal point.
    inverse : ndarray, shape (k, s, s)
        Of the dual point.
    ratio, gram : ndarray, shapes (k, c, s) and (k, s, s)
    """
    num, num_matches, s = B.shape
    moments = np.empty((num, s + 1, s + 1))
    solved, cross = np.empty((num_matches, s)), np.empty((s, s))
    for j in range(num):
        np.dot(ratio[j], inverse[j], solved)
        np.dot(solved.T, mean[j], cross)
        moments[j, 0, 0] = x[j].sum() - 1.0
        for a in range(s):
            total = -R[a]
            for i in range(num_matches):
                total += solved[i, a] + B[j, i, a]
            moments[j, 0, a + 1] = moments[j, a + 1, 0] = total
            for b in range(s):
                moments[j, a + 1, b + 1] = gram[j, a, b] + cross[a, b] + cross[b, a]
    return moments


@numba.njit(cache=True)
def condense_matches(
    T: FloatArray,
    root_weights: FloatArray,
    features: FloatArray,
    root: FloatArray,
    direction: FloatArray,
    rows: IntArray,
    cols: IntArray,
) -> FloatArray:
    """Return the half (k, c, m) of the low-rank term of the moments' operator.

    Parameters
    ----------
    T, root_weights, features, root
        See :class:`pairwise.pm_sdp.newton_blocks.LocalBlocks`.
    direction : ndarray, shape (k, c)
        The unit vector that the points' own sums forbid.
    rows, cols : ndarray of int, shape (m,)
        Of the coordinates.
    """
    num, num_matches, m = features.shape
    halves, moves = np.empty((num, num_matches, m)), np.empty((num_matches, m))
    congruence = np.empty((m, m))
    for j in range(num):
        _fill_congruence(congruence, T[j], root_weights[j], rows, cols)
        np.dot(features[j], congruence, moves)
        np.dot(root[j], moves, halves[j])
        forbidden = np.dot(direction[j], halves[j])
        for i in range(num_matches):
            for e in range(m):
                halves[j, i, e] -= direction[j, i] * forbidden[e]
    return halves


@numba.njit(cache=True)
def _fill_congruence(
    congruence: FloatArray, T: FloatArray, root_weights: FloatArray, rows: IntArray, cols: IntArray
) -> None:
    """Write the matrix (m, m) of ``X -> sqrt(W) * (T X T^T)`` in the coordinates."""
    m, root_half = len(rows), np.sqrt(0.5)
    first, second = np.empty((len(T), m)), np.empty((len(T), m))
    for a in range(len(T)):
        for f in range(m):
            half = root_half if rows[f] == cols[f] else 1.0
            first[a, f], second[a, f] = half * T[a, rows[f]], T[a, cols[f]]
    for e in range(m):
        a, b = rows[e], cols[e]
        left = root_weights[e] * (root_half if a == b else 1.0)
        for f in range(m):
            congruence[e, f] = left * (first[a, f] * second[b, f] + first[b, f] * second[a, f])


@numba.njit(cache=True)
def quaternion_operators(primal: FloatArray, dual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Diagonalise ``X -> sym(dual^-1 X primal)`` on symmetric 4x4 matrices: T and W with ``T^T (W * (T . T^T)) T``.

    Parameters
    ----------
    primal, dual : ndarray, shape (q, 4, 4)
        Positive definite Y of both points.
    """
    T, weights = np.empty(primal.shape), np.empty(primal.shape)
    for q in range(len(primal)):
        factor = np.linalg.cholesky(dual[q])
        eigenvalues, vectors = np.linalg.eigh(np.dot(np.dot(factor.T, primal[q]), factor))
        eigenvalues = np.maximum(eigenvalues, _TINY)
        T[q] = np.dot(vectors.T, factor.T)
        for a in range(4):
            for b in range(4):
                weights[q, a, b] = 2.0 / (eigenvalues[a] + eigenvalues[b])
    return T, weights


@numba.njit(cache=True)
def quaternion_step(T: FloatArray, weights: FloatArray, rhs: FloatArray) -> FloatArray:
    """Return dY (q, 4, 4) of the dual blocks for right hand sides of their equations."""
    solved = np.empty(rhs.shape)
    for q in range(len(rhs)):
        inner = np.dot(np.dot(T[q], np.ascontiguousarray(rhs[q])), T[q].T) * weights[q]
        solved[q] = np.dot(np.dot(T[q].T, inner), T[q])
    return solved


@numba.njit(cache=True)
def packed_sum(
    F: FloatArray,
    u: FloatArray,
    slopes: FloatArray,
    Y: FloatArray,
    rows: IntArray,
    cols: IntArray,
    scale: FloatArray,
) -> FloatArray:
    """Return the coordinates (m,) of what the equations' multipliers must span: the sum of F, u and Y's part.

    Parameters
    ----------
    F, u, Y : ndarray, shapes (k, s, s), (k, s) and (q, 4, 4)
        Of a dual point or a step.
    slopes : ndarray, shape (q, s, 4, 4)
    rows, cols, scale : ndarray, shape (m,)
        Of the coordinates.
    """
    dim = u.shape[1]
    matrix = np.zeros((dim + 1, dim + 1))
    for j in range(len(F)):
        for a in range(dim):
            matrix[0, a + 1] += u[j, a]
            for b in range(dim):
                matrix[a + 1, b + 1] += F[j, a, b]
    packed = np.empty(len(rows))
    for e in range(len(rows)):
        packed[e] = matrix[rows[e], cols[e]] * scale[e]
    for q in range(len(Y)):
        for a in range(dim):
            packed[a] += _ROOT_HALF * (slopes[q, a] * Y[q]).sum()
    return packed
