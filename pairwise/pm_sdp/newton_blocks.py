"""One block of the Newton system for every source point: its own variables, eliminated.

With the notation of :mod:`pairwise.pm_sdp.newton`, the block takes a right hand side of the moment equation and a
push on every match's complementarity, and answers with ``dx`` and ``Delta``. In the coordinates of
:class:`pairwise.pm_sdp.moment_basis.MomentBasis`, after the congruence by T that makes the first operator diagonal,
a match is its feature ``f_i = sqrt(W) * (T b_i) (T b_i)^T``, and everything is products of features:

    response = diag(s / x) + f f^T      (of the costs to the probabilities, c x c).

Woodbury's formula, m x m, would be 1.2 times as fast at 100 points in three dimensions (2.7 times at 200), where
branch and bound proves poses; with more coordinates than matches it is slower. Blocks compiled one by one were 1.8
times as fast in three dimensions and 1.4 times in seven, in 570 lines more.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.moment_basis import MomentBasis, gram
from pairwise.pm_sdp.variables import DualPoint, PrimalPoint

#: Floor of eigenvalues that are positive but for rounding errors.
TINY = float(np.finfo(np.float64).tiny) ** 0.5

#: Numbers that are formed at a time when points are treated in chunks.
_CHUNK_ENTRIES = 2**15


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
        self.features = np.ascontiguousarray(np.swapaxes(features_t, 1, 2))
        self._invert(primal.x / dual.s)
        self.totals = (np.swapaxes(self.root, 1, 2) @ (self.root @ self.ones[..., None]))[..., 0] * self.ones
        self.inverse_total = self.totals.sum(axis=1)
        self.share = self.totals / self.inverse_total[:, None]

    def _diagonalise(self, primal: PrimalPoint, dual: DualPoint) -> None:
        """Find T with ``T H T^T = diag(m)`` and ``T E T^T = diag(e)``, and the roots of 1 / (m_a e_b + e_a m_b)."""
        total = primal.x.sum(axis=1)
        middle = primal.B.sum(axis=1) / total[:, None]
        centred = np.sqrt(primal.x)[..., None] * (primal.mean - middle[:, None])
        spread = np.swapaxes(centred, 1, 2) @ centred + 0.5 * primal.G
        values, vectors = np.linalg.eigh(np.swapaxes(dual.factor, 1, 2) @ spread @ dual.factor)
        turns = np.swapaxes(dual.factor @ vectors, 1, 2)
        self.T = np.zeros((len(total), *np.add(spread.shape[1:], 1)))
        self.T[:, 0, 0], self.T[:, 1:, 1:] = total**-0.5, turns
        self.T[:, 1:, 0] = -(turns @ middle[..., None])[..., 0]
        self.eigenvalues = eigenvalues = np.maximum(values, TINY)
        W = np.ones(self.T.shape)
        W[:, 1:, 1:] = np.sqrt(1.0 / (eigenvalues[:, :, None] + eigenvalues[:, None, :]))
        self.root_weights = W.reshape(len(W), -1).take(self.basis.flat, axis=1)

    def _invert(self, conductance: FloatArray) -> None:
        """Factor the response, given x / s: a root of its inverse."""
        response = self.features @ np.swapaxes(self.features, 1, 2)
        diagonal = np.arange(response.shape[1])
        response[:, diagonal, diagonal] += 1.0 / np.where(self.data.valid, conductance, 1.0)
        self.root = np.linalg.inv(np.linalg.cholesky(response))

    def condense(self) -> tuple[FloatArray, FloatArray]:
        """Return the blocks' share of the moments' operator (m, m) and of its coupling (n, m) to the rows."""
        basis, root = self.basis, self.root
        direction = root @ (self.ones / np.sqrt(self.inverse_total)[:, None])[..., None]
        halves = np.empty((*self.ones.shape, basis.num_coordinates))
        for points in self._chunks():
            chunk = np.matmul(root[points], self._moves(points), out=halves[points])
            chunk -= direction[points] * (np.swapaxes(direction[points], 1, 2) @ chunk)
        flat = halves.reshape(-1, basis.num_coordinates)
        operator = basis.congruence_sum(self.T, self.eigenvalues)
        operator -= gram(flat)
        if self.data.is_complete:
            return operator, root.reshape(len(flat), -1).T @ flat
        return operator, self.data.row_sums(np.swapaxes(root, 1, 2) @ halves)

    def _chunks(self) -> list[slice]:
        """Split the points so that what is formed for a chunk stays in the processor's cache."""
        num, size = len(self.ones), self.basis.num_coordinates
        step = max(1, _CHUNK_ENTRIES // (size * max(size, self.ones.shape[1])))
        return [slice(start, start + step) for start in range(0, num, step)]

    def _moves(self, points: slice) -> FloatArray:
        """Return how the costs of the matches of some points depend on the moments, shape (., c, m)."""
        basis = self.basis
        T = self.T[points]
        transformed = np.ascontiguousarray(np.swapaxes(self.transformed[points], 1, 2))
        k, c, size = transformed.shape
        pairs = transformed[..., :, None] * transformed[..., None, :]
        pairs *= basis.unpack(self.root_weights[points] ** 2 * basis.scale)[:, None]
        half = (pairs.reshape(k, c * size, size) @ T).reshape(k, c, size, size)
        outer = np.ascontiguousarray(np.swapaxes(half, 2, 3)).reshape(k, c * size, size) @ T
        moves: FloatArray = outer.reshape(k, c, -1).take(basis.flat, axis=2)
        moves *= basis.scale
        return moves

    def row_matrix(self) -> FloatArray:
        """Return the (n, n) matrix of the row sums."""
        data, root = self.data, self.root
        if data.is_complete:
            flat = root.reshape(-1, root.shape[2])
            rows: FloatArray = flat.T @ flat - self.share.T @ self.totals
            return rows
        response = np.swapaxes(root, 1, 2) @ root - self.share[:, :, None] * self.totals[:, None, :]
        response *= self.ones[:, :, None] * self.ones[:, None, :]
        sums = np.bincount(data.row_pairs, response.ravel(), data.num_rows**2)
        return sums.astype(np.float64, copy=False).reshape(data.num_rows, -1)

    def solve(self, rhs: FloatArray, push: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dx and Delta of every point for given right hand sides of its own two equations."""
        basis, turned = self.basis, np.swapaxes(self.T, 1, 2)
        inner = basis.pack(self.T @ rhs @ turned) * self.root_weights
        pushed = (push - (self.features @ inner[..., None])[..., 0]) * self.ones
        reaction = (np.swapaxes(self.root, 1, 2) @ (self.root @ pushed[..., None]))[..., 0]
        excess = reaction.sum(axis=1) + rhs[:, 0, 0]
        dx = reaction - self.share * excess[:, None]
        inner += (np.swapaxes(self.features, 1, 2) @ dx[..., None])[..., 0]
        local = turned @ basis.unpack(inner * self.root_weights) @ self.T
        local = 0.5 * (local + np.swapaxes(local, 1, 2))
        local[:, 0, 0] += excess / self.inverse_total
        return dx, local
