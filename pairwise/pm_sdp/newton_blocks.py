"""One block of the Newton system for every source point: its own variables, eliminated.

With the notation of :mod:`pairwise.pm_sdp.newton`, the block takes a right hand side of the moment equation and a
push on every match's complementarity, and answers with ``dx`` and ``Delta``. In the coordinates of
:class:`pairwise.pm_sdp.moment_basis.MomentBasis`, after the congruence by T that makes the first operator diagonal,
a match is
its feature ``f_i = sqrt(W) * (T b_i) (T b_i)^T``, and everything is products of features:

    response = diag(s / x) + f f^T      (of the costs to the probabilities, c x c), or by Woodbury
    inner    = I + f^T diag(x / s) f    (m x m) where there are more matches than coordinates.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.moment_basis import MomentBasis, gram
from pairwise.pm_sdp.variables import DualPoint, PrimalPoint

#: Floor of eigenvalues that are positive but for rounding errors.
TINY = float(np.finfo(np.float64).tiny) ** 0.5

#: Up to this many variables the matrices of congruences are formed; beyond, factors are applied one after the other.
_DENSE_SIZE = 12

#: Numbers that are formed at a time when points are treated in chunks.
_CHUNK_ENTRIES = 2**15

#: From this size on, triangular factors are inverted by LAPACK's own routine rather than as general matrices.
_TRIANGULAR_SIZE = 16


class LocalBlocks:
    """The blocks of all source points at one pair of primal and dual points.

    Attributes
    ----------
    share : ndarray, shape (k, c)
        How the probabilities of one point move when their sum grows by one.
    inverse_total : ndarray, shape (k,)
        Sum of the response's inverse.
    """

    def __init__(self, data: RelaxationData, basis: MomentBasis, primal: PrimalPoint, dual: DualPoint) -> None:
        self.data, self.basis = data, basis
        self._diagonalise(primal, dual)
        lifted = np.concatenate([np.where(data.valid, 1.0, 0.0)[..., None], dual.mean], axis=2)
        self.ones = np.ascontiguousarray(lifted[..., 0])
        self.transformed = self.T @ np.swapaxes(lifted, 1, 2)
        features_t = self.transformed.take(basis.rows, axis=1)
        features_t *= self.transformed.take(basis.cols, axis=1)
        features_t *= (self.root_weights * basis.scale)[..., None]
        self.features = np.swapaxes(features_t, 1, 2)
        self.conductance = primal.x / dual.s
        if not data.is_full:
            self.conductance[~data.valid] = 1.0
        self.by_matches = self.ones.shape[1] <= basis.num_coordinates
        if self.by_matches:
            self._invert_by_matches()
        else:
            self._invert_by_features()
        self.totals = self._invert(self.ones) * self.ones
        self.inverse_total = self.totals.sum(axis=1)
        self.share = self.totals / self.inverse_total[:, None]

    def _diagonalise(self, primal: PrimalPoint, dual: DualPoint) -> None:
        """Find T with ``T H T^T = diag(m)`` and ``T E T^T = diag(e)``, and the roots of 1 / (m_a e_b + e_a m_b)."""
        total = primal.x.sum(axis=1)
        first = primal.B.sum(axis=1)
        centred = np.sqrt(primal.x)[..., None] * (primal.mean - (first / total[:, None])[:, None, :])
        spread = np.swapaxes(centred, 1, 2) @ centred + 0.5 * primal.G
        factor_t = np.swapaxes(dual.factor, 1, 2)
        eigenvalues, vectors = np.linalg.eigh(factor_t @ spread @ dual.factor)
        num, size = first.shape
        T = np.zeros((num, size + 1, size + 1))
        T[:, 1:, 1:] = np.swapaxes(vectors, 1, 2) @ factor_t
        T[:, 1:, 0] = -(T[:, 1:, 1:] @ first[:, :, None])[..., 0] / total[:, None]
        T[:, 0, 0] = 1.0 / np.sqrt(total)
        self.eigenvalues = eigenvalues = np.maximum(eigenvalues, TINY)
        W = np.ones((num, size + 1, size + 1))
        W[:, 1:, 1:] = np.sqrt(1.0 / (eigenvalues[:, :, None] + eigenvalues[:, None, :]))
        self.T, self.T_t = T, np.ascontiguousarray(np.swapaxes(T, 1, 2))
        self.root_weights = W.reshape(num, -1).take(self.basis.flat, axis=1)

    def _invert_by_matches(self) -> None:
        """Factor the response: a root of its inverse."""
        response = self.features @ np.swapaxes(self.features, 1, 2)
        diagonal = np.arange(response.shape[1])
        response[:, diagonal, diagonal] += 1.0 / self.conductance
        self.root = inverse_factors(response)

    def _invert_by_features(self) -> None:
        """Factor the matrix of Woodbury's formula, ``response^-1 = diag(x / s) - half^T half``."""
        weighted = self.conductance[..., None] * self.features
        inner = np.swapaxes(self.features, 1, 2) @ weighted
        diagonal = np.arange(inner.shape[1])
        inner[:, diagonal, diagonal] += 1.0
        self.root = inverse_factors(inner)
        self.half = self.root @ np.swapaxes(weighted, 1, 2)

    def _invert(self, values: FloatArray) -> FloatArray:
        """Apply the inverse of the response to values (k, c)."""
        root = self.root if self.by_matches else self.half
        product: FloatArray = (np.swapaxes(root, 1, 2) @ (root @ values[..., None]))[..., 0]
        return product if self.by_matches else self.conductance * values - product

    def condense(self) -> tuple[FloatArray, FloatArray]:
        """Return the blocks' share of the moments' operator (m, m) and of its coupling (n, m) to the rows."""
        return self._condense_matches() if self.by_matches else self._condense_features()

    def _condense_matches(self) -> tuple[FloatArray, FloatArray]:
        num = self.basis.num_coordinates
        root = self.root.astype(self.basis.dtype, copy=False)
        direction = root @ (self.ones / np.sqrt(self.inverse_total)[:, None]).astype(root.dtype)[..., None]
        halves = np.empty((*self.ones.shape, num), dtype=root.dtype)
        for points in self._chunks():
            chunk = np.matmul(root[points], self._moves(points), out=halves[points])
            chunk -= direction[points] * (np.swapaxes(direction[points], 1, 2) @ chunk)
        flat = halves.reshape(-1, num)
        operator = self.basis.congruence_sum(self.T, self.eigenvalues)
        operator -= gram(flat)
        if self.data.is_complete:
            return operator, root.reshape(len(flat), -1).T @ flat
        return operator, self.data.row_sums(np.swapaxes(root, 1, 2) @ halves)

    def _condense_features(self) -> tuple[FloatArray, FloatArray]:
        num = self.basis.num_coordinates
        halves = np.empty_like(self.root)
        mean = self.totals[:, None, :] @ self.features
        for points in self._chunks():
            congruences = self._congruences(points)
            np.matmul(self.root[points], congruences, out=halves[points])
            mean[points] = mean[points] @ congruences
        mean = mean[:, 0]
        flat = halves.reshape(-1, num)
        operator = flat.T @ flat + (mean / self.inverse_total[:, None]).T @ mean
        if self.data.is_complete:
            return operator, self.half.reshape(len(flat), -1).T @ flat - self.share.T @ mean
        reactions = np.swapaxes(self.half, 1, 2) @ halves - self.share[..., None] * mean[:, None, :]
        return operator, self.data.row_sums(reactions)

    def _chunks(self) -> list[slice]:
        """Split the points so that what is formed for a chunk stays in the processor's cache."""
        num, size = len(self.ones), self.basis.num_coordinates
        step = max(1, _CHUNK_ENTRIES // (size * max(size, self.ones.shape[1])))
        return [slice(start, start + step) for start in range(0, num, step)]

    def _congruences(self, points: slice) -> FloatArray:
        """Return the matrices (., m, m) of ``X -> sqrt(W) * (T X T^T)``."""
        matrices = self.basis.congruences(self.T[points])
        matrices *= self.root_weights[points, :, None]
        return matrices

    def _moves(self, points: slice) -> FloatArray:
        """Return how the costs of the matches of some points depend on the moments, shape (., c, m)."""
        basis = self.basis
        if basis.size <= _DENSE_SIZE:
            return self.features[points] @ self._congruences(points)
        T = self.T[points].astype(basis.dtype, copy=False)
        transformed = np.ascontiguousarray(np.swapaxes(self.transformed[points], 1, 2), dtype=basis.dtype)
        k, c, size = transformed.shape
        pairs = transformed[..., :, None] * transformed[..., None, :]
        pairs *= basis.unpack(self.root_weights[points] ** 2 * basis.scale).astype(basis.dtype, copy=False)[:, None]
        half = (pairs.reshape(k, c * size, size) @ T).reshape(k, c, size, size)
        outer = np.ascontiguousarray(np.swapaxes(half, 2, 3)).reshape(k, c * size, size) @ T
        moves: FloatArray = outer.reshape(k, c, -1).take(basis.flat, axis=2)
        moves *= basis.scale.astype(basis.dtype)
        return moves

    def row_matrix(self) -> FloatArray:
        """Return the (n, n) matrix of the row sums."""
        data = self.data
        root = self.root if self.by_matches else self.half
        sign = 1.0 if self.by_matches else -1.0
        if data.is_complete:
            flat = root.reshape(-1, root.shape[2])
            rows: FloatArray = sign * (flat.T @ flat) - self.share.T @ self.totals
            if not self.by_matches:
                rows[np.diag_indices_from(rows)] += self.conductance.sum(axis=0)
            return rows
        response = sign * (np.swapaxes(root, 1, 2) @ root) - self.share[:, :, None] * self.totals[:, None, :]
        if not self.by_matches:
            diagonal = np.arange(response.shape[1])
            response[:, diagonal, diagonal] += self.conductance
        response *= self.ones[:, :, None] * self.ones[:, None, :]
        sums = np.bincount(data.row_pairs, response.ravel(), data.num_rows**2)
        return sums.astype(np.float64, copy=False).reshape(data.num_rows, -1)

    def solve(self, rhs: FloatArray, push: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dx and Delta of every point for given right hand sides of its own two equations."""
        T, T_t, features = self.T, self.T_t, self.features
        inner = self.basis.pack(T @ rhs @ T_t) * self.root_weights
        push = (push - (features @ inner[..., None])[..., 0]) * self.ones
        missing = -rhs[:, 0, 0]
        pushed = self._invert(push)
        excess = pushed.sum(axis=1) - missing
        dx = pushed - self.share * excess[:, None]
        inner += (dx[:, None, :] @ features)[:, 0]
        local = T_t @ self.basis.unpack(inner * self.root_weights) @ T
        local[:, 0, 0] += excess / self.inverse_total
        return dx, 0.5 * (local + np.swapaxes(local, 1, 2))


def inverse_factors(matrices: FloatArray) -> FloatArray:
    """Return the inverses of the Cholesky factors of positive definite matrices (k, m, m).

    Raises
    ------
    numpy.linalg.LinAlgError
        If a matrix is not positive definite.
    """
    factors: FloatArray = np.linalg.cholesky(matrices).astype(np.float64, copy=False)
    if factors.shape[1] < _TRIANGULAR_SIZE:
        return np.linalg.inv(factors).astype(np.float64, copy=False)
    for factor in factors:
        inverse, info = lapack.dtrtri(factor.T)
        if info != 0:
            raise np.linalg.LinAlgError("singular triangular factor")
        factor[...] = inverse.T
    return factors
