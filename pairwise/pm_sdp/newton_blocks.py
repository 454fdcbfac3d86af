"""One block of the Newton system for every source point: its own variables, eliminated.

With the notation of :mod:`pairwise.pm_sdp.newton`, the block takes a right hand side of the moment equation and a
push on every match's complementarity, and answers with ``dx`` and ``Delta``. In the coordinates of
:class:`pairwise.pm_sdp.moment_basis.MomentBasis`, after the congruence by T that makes the first operator diagonal,
a match is its feature ``f_i = sqrt(W) * (T b_i) (T b_i)^T``, and everything is products of features:

    response = diag(s / x) + f f^T      (of the costs to the probabilities, c x c).

The multiplier e_i of a tied row moves the block by the features ``f_ia = sqrt(W) * (T m_i) (T F^-1 unit_a)^T x_i``,
symmetrised, and pushes match i by its mean less the share of these features.

Woodbury's formula, m x m, would be faster at many points in three dimensions, where branch and bound proves poses;
with more coordinates than matches it is slower.
"""

from __future__ import annotations

import time

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.moment_basis import MomentBasis, gram
from pairwise.pm_sdp.variables import DualPoint, PrimalPoint, inverse_factors

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

    def __init__(
        self, data: RelaxationData, basis: MomentBasis, primal: PrimalPoint, dual: DualPoint
    ) -> None:
        self.data, self.basis = data, basis
        self._diagonalise(primal, dual)
        lifted = np.concatenate([np.where(data.valid, 1.0, 0.0)[..., None], dual.mean], axis=2)
        self.ones = np.ascontiguousarray(lifted[..., 0])
        self.transformed = self.T @ np.swapaxes(lifted, 1, 2)
        features_t = self.transformed.take(basis.rows, axis=1)
        features_t *= self.transformed.take(basis.cols, axis=1)
        features_t *= (self.root_weights * basis.scale)[..., None]
        self.features = np.ascontiguousarray(np.swapaxes(features_t, 1, 2))
        if data.tied.any():
            lifted_means = np.concatenate([self.ones[..., None], primal.mean], axis=2)
            self.means, self.x, self.b = (
                lifted_means @ np.swapaxes(self.T, 1, 2),
                primal.x,
                dual.mean,
            )
            self.units = np.zeros((len(self.T), *np.subtract(self.T.shape[1:], (1, 0))))
            self.units[:, :, 1:] = dual.inverse @ np.swapaxes(self.T[:, 1:, 1:], 1, 2)
            self.inverse = dual.inverse
        self._invert(primal.x / dual.s)
        self.totals = (np.swapaxes(self.root, 1, 2) @ (self.root @ self.ones[..., None]))[
            ..., 0
        ] * self.ones
        self.inverse_total = self.totals.sum(axis=1)
        self.share = self.totals / self.inverse_total[:, None]

    def _diagonalise(self, primal: PrimalPoint, dual: DualPoint) -> None:
        """Find T with ``T H T^T = diag(m)`` and ``T E T^T = diag(e)``, and the roots of 1 / (m_a e_b + e_a m_b)."""
        total = primal.x.sum(axis=1)
        middle = primal.B.sum(axis=1) / total[:, None]
        centred = np.sqrt(primal.x)[..., None] * (primal.mean - middle[:, None])
        spread = np.swapaxes(centred, 1, 2) @ centred + 0.5 * primal.G
        values, vectors = np.linalg.eigh(np.swapaxes(dual.factor, 1, 2) @ spread @ dual.factor)
        rotations = np.swapaxes(dual.factor @ vectors, 1, 2)
        self.T = np.zeros((len(total), *np.add(spread.shape[1:], 1)))
        self.T[:, 0, 0], self.T[:, 1:, 1:] = total**-0.5, rotations
        self.T[:, 1:, 0] = -(rotations @ middle[..., None])[..., 0]
        self.eigenvalues = eigenvalues = np.maximum(values, TINY)
        W = np.ones(self.T.shape)
        W[:, 1:, 1:] = np.sqrt(1.0 / (eigenvalues[:, :, None] + eigenvalues[:, None, :]))
        self.root_weights = W.reshape(len(W), -1).take(self.basis.flat, axis=1)

    def _invert(self, conductance: FloatArray) -> None:
        """Factor the response, given x / s: a root of its inverse."""
        response = self.features @ np.swapaxes(self.features, 1, 2)
        diagonal = np.arange(response.shape[1])
        response[:, diagonal, diagonal] += 1.0 / np.where(self.data.valid, conductance, 1.0)
        self.root = inverse_factors(np.linalg.cholesky(response))

    def condense(self, deadline: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the blocks' share of the moments' operator, of its coupling to the rows, and of the rows' matrix.

        Their shapes are (m, m), (p, m) and (p, p), for the p = n + s t unknowns beta and e of n rows, t of them tied.
        """
        data, basis = self.data, self.basis
        num, size = data.num_rows, data.lifted.num_variables
        direction = self.root @ (self.ones / np.sqrt(self.inverse_total)[:, None])[..., None]
        projected = (
            self.root - direction * (np.swapaxes(direction, 1, 2) @ self.root)
        ) * self.ones[:, None]
        operator = basis.congruence_sum(self.T, self.eigenvalues)
        unknowns = num + size * int(data.tied.sum())
        coupling, rows = np.zeros((unknowns, basis.num_coordinates)), np.zeros((unknowns, unknowns))
        for points in self._chunks():
            if time.perf_counter() > deadline:
                raise TimeoutError
            halves = (projected[points] @ self._moves(points)).reshape(-1, basis.num_coordinates)
            pulls = self._spread(points, np.swapaxes(projected[points], 1, 2), 0)
            if data.tied.any():
                features = self._row_features(points)
                pushes = self._row_pushes(points, projected[points], features)
                pulls = np.concatenate([pulls, self._spread(points, pushes, 1)], axis=1)
                rows[num:, num:] -= 0.25 * gram(self._spread(points, features, 1))
                coupling[num:] += 0.5 * self._row_moves(points)
            operator -= gram(halves)
            coupling += pulls.T @ halves
            rows += gram(pulls)
        if data.tied.any():
            each = np.arange(num, unknowns)
            coupling[each, (each - num) % size] -= np.sqrt(0.5)
            own = (
                0.5
                * (data.scatter(self.x) @ self.inverse.reshape(len(self.inverse), -1))[data.tied]
            )
            blocks = rows[num:, num:].reshape(len(own), size, len(own), size)
            blocks[np.arange(len(own)), :, np.arange(len(own))] += own.reshape(-1, size, size)
        return operator, coupling, rows

    def _chunks(self) -> list[slice]:
        """Split the points so that what is formed for a chunk stays in the processor's cache."""
        num, size = len(self.ones), self.basis.num_coordinates
        step = max(1, _CHUNK_ENTRIES // (size * max(size, self.ones.shape[1])))
        return [slice(start, min(start + step, num)) for start in range(0, num, step)]

    def _spread(self, points: slice, values: FloatArray, which: int) -> FloatArray:
        """Return matches' values (., c, ..., q) as a matrix of all rows of some points, (. q, slots ...).

        ``which`` says whose slots: of all rows, or of the tied ones.
        """
        slots, num = (
            self.data.multiplier_slots[which][points],
            (self.data.num_rows, int(self.data.tied.sum()))[which],
        )
        k, _, *inner, q = values.shape
        full = np.zeros((k, num + 1, *inner, q))
        full[np.arange(k)[:, None], slots] = values
        kept = np.moveaxis(full[:, :num].reshape(k, -1, q), 2, 1)
        return kept.reshape(k * q, -1)

    def _row_features(self, points: slice) -> FloatArray:
        """Return the features of the multipliers of tied rows, shape (., c, s, m)."""
        basis, means, units = (
            self.basis,
            self.means[points] * self.x[points][..., None],
            self.units[points],
        )
        weights = self.root_weights[points] * basis.scale
        heads, tails = means.take(basis.rows, axis=2), means.take(basis.cols, axis=2)
        features = heads[:, :, None] * (units.take(basis.cols, axis=2) * weights[:, None])[:, None]
        features += tails[:, :, None] * (units.take(basis.rows, axis=2) * weights[:, None])[:, None]
        return features

    def _row_moves(self, points: slice) -> FloatArray:
        """Return how the moments move the multipliers of tied rows, by what some points add to it, shape (t s, m)."""
        basis, means, T = self.basis, self.means[points] * self.x[points][..., None], self.T[points]
        k, _, size = means.shape
        W = basis.unpack(self.root_weights[points] ** 2 * basis.scale)
        left = (np.swapaxes(T, 1, 2)[:, None] * means[:, :, None]) @ W[:, None]
        right = (
            (self.units[points][..., None] * T[:, None]).transpose(0, 2, 1, 3).reshape(k * size, -1)
        )
        rotated = (self._spread(points, left, 1).T @ right).reshape(-1, size, size - 1, size)
        flat = np.swapaxes(rotated, 1, 2).reshape(-1, size * size)
        moves = flat.take(basis.flat, axis=1)
        moves += flat.take(basis.cols * size + basis.rows, axis=1)
        moves *= basis.scale
        return moves

    def _row_pushes(self, points: slice, projected: FloatArray, features: FloatArray) -> FloatArray:
        """Return how the tied rows' multipliers push the matches, projected, shape (., c, s, c)."""
        k, c, s, m = features.shape
        mixed = (projected @ self.features[points]) @ np.swapaxes(
            features.reshape(k, c * s, m), 1, 2
        )
        own = np.swapaxes(projected, 1, 2)[:, :, None] * self.b[points][..., None]
        return own - 0.5 * np.moveaxis(mixed.reshape(k, c, c, s), 1, 3)

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

    def solve(self, rhs: FloatArray, push: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dx (k, c) and Delta of every point for a right hand side (k, s+1, s+1) and a push (k, c)."""
        basis, transposed = self.basis, np.swapaxes(self.T, 1, 2)
        inner = basis.pack(self.T @ rhs @ transposed) * self.root_weights
        pushed = (push - (self.features @ inner[..., None])[..., 0]) * self.ones
        reaction = (np.swapaxes(self.root, 1, 2) @ (self.root @ pushed[..., None]))[..., 0]
        excess = reaction.sum(axis=1) + rhs[:, 0, 0]
        dx = reaction - self.share * excess[:, None]
        inner += (np.swapaxes(self.features, 1, 2) @ dx[..., None])[..., 0]
        local = transposed @ basis.unpack(inner * self.root_weights) @ self.T
        local = 0.5 * (local + np.swapaxes(local, 1, 2))
        local[:, 0, 0] += excess / self.inverse_total
        return dx, local
