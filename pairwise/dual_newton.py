"""The Newton system of the interior-point method, eliminated point by point.

In terms of ``Delta_j = [[-d alpha_j, d u_j^T], [d u_j, d F_j]]``, ``b = (1, F^-1 w)``, ``E = diag(0, F^-1)`` and
``H_j = sum_i x_i (1, b_i)(1, b_i)^T + diag(0, G_j) / 2``, every source point contributes

    H Delta E + E Delta H - sum_i dx_i b_i b_i^T + dM = rhs_j                 (moments; HKM scaling of F G = mu I)
    dx_i = rho_i / s_i - (x_i / s_i) (b_i^T Delta b_i - d beta_i)             (complementarity x s = mu)

and the points meet in ``sum_j Delta_j = sum_m dy_m A_m`` and in the row sums of x. One generalised eigendecomposition
of (H, F^-1) per point turns the first operator into a diagonal one; the matches are a term of low rank in it.
What remains is a positive definite system in the moments dM (within the null space of the equations) and d beta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from data_tools.arrays import BoolArray, FloatArray
from pairwise.dual_basis import MomentBasis
from pairwise.dual_points import Direction, DualPoint, PrimalPoint
from pairwise.relaxation import RelaxationData


@dataclass(frozen=True, eq=False)
class Targets:
    """Right hand sides of the linearised equations.

    Attributes
    ----------
    moments : ndarray, shape (k, s+1, s+1)
        Of the moment equation of each source point.
    products : ndarray, shape (k, c)
        Of ``s dx + x ds``.
    slacks : ndarray, shape (n,)
        Of ``-beta dslack - slack dbeta``.
    quaternions : tuple of ndarray (4, 4)
        Of ``dY_primal + sym(Y_dual^-1 dY_dual Y_primal)``.
    ratio : ndarray, shape (k, c, s)
        Of ``F dB + dF B - x dw - w dx``.
    """

    moments: FloatArray
    products: FloatArray
    slacks: FloatArray
    quaternions: tuple[FloatArray, ...]
    ratio: FloatArray


class NewtonSystem:
    """Factorisation of the Newton system at one pair of primal and dual points."""

    def __init__(self, data: RelaxationData, basis: MomentBasis, primal: PrimalPoint, dual: DualPoint) -> None:
        self.data, self.basis, self.primal, self.dual = data, basis, primal, dual
        self._diagonalise()
        self._respond()
        self._quaternion_operators()
        self._assemble()

    def _diagonalise(self) -> None:
        """Find T with ``T H T^T = diag(m)`` and ``T E T^T = diag(e)``, and the weights 1 / (m_a e_b + e_a m_b)."""
        primal, dual = self.primal, self.dual
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
        W = np.ones((num, size + 1, size + 1))
        eigenvalues = np.maximum(eigenvalues, np.finfo(float).tiny ** 0.5)
        W[:, 1:, 1:] = 1.0 / (eigenvalues[:, :, None] + eigenvalues[:, None, :])
        W[:, 0, 0] = 0.0
        self.T, self.W = T, W

    def _respond(self) -> None:
        """Set up how the probabilities of one point respond to changes of their costs, at fixed sum."""
        data, primal, dual = self.data, self.primal, self.dual
        T, W, basis = self.T, self.W, self.basis
        lifted = np.concatenate([np.where(data.valid, 1.0, 0.0)[..., None], dual.mean], axis=2)
        transformed = lifted @ np.swapaxes(T, 1, 2)
        root = np.sqrt(W[:, basis.rows, basis.cols]) * basis.scale
        features = transformed[:, :, basis.rows] * transformed[:, :, basis.cols] * root[:, None, :]
        self.conductance = np.where(data.valid, primal.x / dual.s, 1.0)
        inverse = self._inverse_response(features)
        totals = inverse @ np.where(data.valid, 1.0, 0.0)[..., None]
        self.share = totals[..., 0] / totals.sum(axis=1)
        both = data.valid[:, :, None] & data.valid[:, None, :]
        self.response = np.where(both, inverse - self.share[:, :, None] * np.swapaxes(totals, 1, 2), 0.0)
        self.inverse_total = totals[:, :, 0].sum(axis=1)
        self.inverse = inverse
        outer = self._weigh(transformed[..., :, None] * transformed[..., None, :])
        self.moves = basis.pack(outer)

    def _weigh(self, matrices: FloatArray) -> FloatArray:
        """Return ``T^T (W * X) T`` for X of shape (k, c, s+1, s+1)."""
        T = self.T[:, None]
        return np.swapaxes(T, 2, 3) @ (self.W[:, None] * matrices) @ T

    def _inverse_response(self, features: FloatArray) -> FloatArray:
        """Return ``(diag(s / x) + features features^T)^-1``, by whichever side is smaller."""
        conductance = self.conductance
        num_matches, num_features = features.shape[1:]
        if num_matches <= num_features:
            dense = features @ np.swapaxes(features, 1, 2)
            diagonal = np.arange(num_matches)
            dense[:, diagonal, diagonal] += 1.0 / conductance
            return np.linalg.inv(dense).astype(np.float64, copy=False)
        weighted = conductance[..., None] * features
        inner = np.swapaxes(features, 1, 2) @ weighted
        diagonal = np.arange(num_features)
        inner[:, diagonal, diagonal] += 1.0
        half = np.linalg.inv(np.linalg.cholesky(inner)) @ np.swapaxes(weighted, 1, 2)
        result = -np.swapaxes(half, 1, 2) @ half
        matches = np.arange(num_matches)
        result[:, matches, matches] += conductance
        return result

    def _quaternion_operators(self) -> None:
        """Diagonalise ``X -> sym(Y_dual^-1 X Y_primal)`` on symmetric 4x4 matrices, one per rotation block."""
        self.quaternion_maps = []
        for primal, dual in zip(self.primal.Y, self.dual.Y, strict=True):
            factor = np.linalg.cholesky(dual)
            eigenvalues, vectors = np.linalg.eigh(factor.T @ primal @ factor)
            eigenvalues = np.maximum(eigenvalues, np.finfo(float).tiny ** 0.5)
            weights = 2.0 / (eigenvalues[:, None] + eigenvalues)
            self.quaternion_maps.append((vectors.T @ factor.T, weights))

    def _assemble(self) -> None:
        """Form and factor the reduced system."""
        data, basis = self.data, self.basis
        num = basis.num_coordinates
        reactions = self.response @ self.moves
        moments = basis.congruence_sum(self.T, self.W)
        moments -= self.moves.reshape(-1, num).T @ reactions.reshape(-1, num)
        means = slice(0, data.lifted.num_variables)
        for (_, slopes), (T, weights) in zip(data.lifted.quaternion_blocks, self.quaternion_maps, strict=True):
            transformed = ((T @ slopes @ T.T) * np.sqrt(weights)).reshape(-1, 16)
            moments[means, means] += 0.5 * transformed @ transformed.T
        rows = self._row_matrix()
        coupling = np.zeros((data.num_rows, num))
        np.add.at(coupling, data.index[data.valid], reactions[data.valid])
        coupling[self.pinned] = 0.0
        self.coupling = basis.reduce_columns(coupling.T)
        self.rows_factor = _factor(rows)
        schur = basis.reduce_operator(moments)
        schur += self.coupling @ cho_solve(self.rows_factor, self.coupling.T, check_finite=False)
        self.schur_factor = _factor(0.5 * (schur + schur.T))

    def _row_matrix(self) -> FloatArray:
        """Return the (n, n) matrix of the row sums, one row of each closed component pinned."""
        data = self.data
        n = data.num_rows
        flat = (data.index[:, :, None] * n + data.index[:, None, :]).ravel()
        rows: FloatArray = np.bincount(flat, self.response.ravel(), n * n).reshape(n, n).astype(np.float64)
        free = np.zeros(n)
        open_rows = ~data.equality
        free[open_rows] = self.primal.slack[open_rows] / -self.dual.beta[open_rows]
        rows[np.diag_indices(n)] += free
        pinned = _pinned_rows(data)
        rows[pinned], rows[:, pinned] = 0.0, 0.0
        rows[pinned, pinned] = 1.0
        self.pinned = pinned
        return rows

    def solve(self, targets: Targets) -> Direction:
        """Solve for all variables."""
        data, basis, primal, dual = self.data, self.basis, self.primal, self.dual
        zero_moments, zero_rows = np.zeros_like(targets.moments[0]), np.zeros(data.num_rows)
        dx, local = self._local(targets, zero_moments, zero_rows)
        sums, means = local.sum(axis=0), slice(0, data.lifted.num_variables)
        imbalance = basis.pack(sums + self._dual_sum())
        for index, (_, slopes) in enumerate(data.lifted.quaternion_blocks):
            change = self._quaternion_solve(index, targets.quaternions[index])
            change = change + dual.Y[index]
            imbalance[means] += np.sqrt(0.5) * np.tensordot(slopes, change, 2)
        open_rows = ~data.equality
        row_rhs = data.capacity - data_row_sums(data, primal.x + dx) - primal.slack
        row_rhs[open_rows] += targets.slacks[open_rows] / dual.beta[open_rows]
        row_rhs[self.pinned] = 0.0
        reduced = basis.reduce(imbalance) + self.coupling @ cho_solve(self.rows_factor, row_rhs, check_finite=False)
        step = cho_solve(self.schur_factor, reduced, check_finite=False)
        dbeta = cho_solve(self.rows_factor, row_rhs - self.coupling.T @ step, check_finite=False)
        moments = basis.unpack(basis.expand(step))
        dx, local = self._local(targets, moments, dbeta)
        return self._direction(targets, dx, local, moments, dbeta)

    def _dual_sum(self) -> FloatArray:
        """Return ``sum_j [[0, u_j^T], [u_j, F_j]]``, which must be a combination of the equations."""
        dual = self.dual
        total = np.zeros(self.T.shape[1:])
        total[1:, 1:] = dual.F.sum(axis=0)
        total[1:, 0] = total[0, 1:] = dual.u.sum(axis=0)
        return total

    def _local(self, targets: Targets, moments: FloatArray, dbeta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dx and Delta of every point for given changes of the moments and row potentials."""
        data, T = self.data, self.T
        T_t = np.swapaxes(T, 1, 2)
        rhs = targets.moments - moments
        base = T_t @ (self.W * (T @ rhs @ T_t)) @ T
        lifted = np.concatenate([np.ones((*data.index.shape, 1)), self.dual.mean], axis=2)
        predicted = np.einsum("jca,jca->jc", lifted @ base, lifted)
        x_safe = np.where(data.valid, self.primal.x, 1.0)
        push = np.where(data.valid, targets.products / x_safe + dbeta[data.index] - predicted, 0.0)
        missing = -rhs[:, 0, 0]
        pushed = (self.inverse @ push[..., None])[..., 0]
        theta = (pushed.sum(axis=1) - missing) / self.inverse_total
        dx = (self.response @ push[..., None])[..., 0] + missing[:, None] * self.share
        gathered = (dx[..., None] * lifted).swapaxes(1, 2) @ lifted
        local = base + T_t @ (self.W * (T @ gathered @ T_t)) @ T
        local[:, 0, 0] += theta
        return dx, 0.5 * (local + np.swapaxes(local, 1, 2))

    def _quaternion_solve(self, index: int, rhs: FloatArray) -> FloatArray:
        T, weights = self.quaternion_maps[index]
        return T.T @ (weights * (T @ rhs @ T.T)) @ T

    def _direction(
        self, targets: Targets, dx: FloatArray, local: FloatArray, moments: FloatArray, dbeta: FloatArray
    ) -> Direction:
        data, primal, dual = self.data, self.primal, self.dual
        dF, du, dalpha = local[:, 1:, 1:], local[:, 1:, 0], -local[:, 0, 0]
        pull = primal.B @ dF + primal.x[..., None] * du[:, None, :] - targets.ratio
        dB = dx[..., None] * dual.mean - pull @ dual.inverse
        dR = moments[0, 1:]
        dY = tuple(
            self._quaternion_solve(i, targets.quaternions[i] - np.tensordot(dR, slopes, 1))
            for i, (_, slopes) in enumerate(data.lifted.quaternion_blocks)
        )
        dslack = np.zeros(data.num_rows)
        open_rows = ~data.equality
        dslack[open_rows] = (targets.slacks[open_rows] + primal.slack[open_rows] * dbeta[open_rows]) / -dual.beta[
            open_rows
        ]
        return Direction(dx, dB, moments[1:, 1:], dR, dslack, dalpha, dbeta, dF, du, dY)


def data_row_sums(data: RelaxationData, values: FloatArray) -> FloatArray:
    """Return the sums (n,) of matches' values (k, c) over each row."""
    weights = np.where(data.valid, values, 0.0).ravel()
    return np.bincount(data.index.ravel(), weights, data.num_rows).astype(np.float64)


def _pinned_rows(data: RelaxationData) -> BoolArray:
    """One row of each connected component without slack: there the potentials have a gauge."""
    k, n = len(data.index), data.num_rows
    source, slot = np.nonzero(data.valid)
    graph = coo_array((np.ones(len(source)), (source, k + data.index[source, slot])), shape=(k + n, k + n))
    count, labels = connected_components(graph, directed=False)
    open_component = np.zeros(count, dtype=bool)
    open_component[labels[k:][~data.equality]] = True
    first = np.full(count, -1)
    row_labels = labels[k:]
    first[row_labels[::-1]] = np.arange(n)[::-1]
    pinned = np.zeros(n, dtype=bool)
    pinned[first[~open_component]] = True
    return pinned


def _factor(matrix: FloatArray) -> tuple[FloatArray, bool]:
    return cho_factor(matrix, lower=True, check_finite=False)
