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

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from data_tools.arrays import FloatArray
from pairwise.dual_basis import MomentBasis, gram
from pairwise.dual_points import Direction, DualPoint, PrimalPoint, along
from pairwise.dual_targets import Targets
from pairwise.relaxation import RelaxationData

#: R stands beside the diagonal of the moment matrix: its coordinates are scaled by the root of two.
_ROOT_HALF = float(np.sqrt(0.5))

#: Most refinements of a solution of the reduced system.
_MAX_REFINEMENTS = 3

#: A solution is refined until its residual is this share of the right hand side.
_REFINEMENT_TOL = 1e-6

#: Floor of eigenvalues that are positive but for rounding errors.
_TINY = float(np.finfo(np.float64).tiny) ** 0.5


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
        self.eigenvalues = eigenvalues = np.maximum(eigenvalues, _TINY)
        W = np.ones((num, size + 1, size + 1))
        W[:, 1:, 1:] = 1.0 / (eigenvalues[:, :, None] + eigenvalues[:, None, :])
        W[:, 0, 0] = 0.0
        self.T, self.T_t, self.W = T, np.ascontiguousarray(np.swapaxes(T, 1, 2)), W

    def _respond(self) -> None:
        """Set up how the probabilities of one point respond to changes of their costs, at fixed sum."""
        data, basis = self.data, self.basis
        k, c = data.valid.shape
        size = basis.size + 1
        self.ones = np.where(data.valid, 1.0, 0.0)
        self.lifted = np.concatenate([self.ones[..., None], self.dual.mean], axis=2)
        transformed = self.lifted @ self.T_t
        self.conductance = self.primal.x / self.dual.s
        if not data.is_full:
            self.conductance[~data.valid] = 1.0
        pairs = transformed[..., :, None] * transformed[..., None, :]
        pairs *= self.W[:, None]
        half = (pairs.reshape(k, c * size, size) @ self.T).reshape(k, c, size, size)
        outer = np.ascontiguousarray(np.swapaxes(half, 2, 3)).reshape(k, c * size, size) @ self.T
        self.moves = outer.reshape(k, c, -1).take(basis.flat, axis=2) * basis.scale
        if c <= basis.num_coordinates:
            self._invert_by_matches(transformed, pairs)
        else:
            self._invert_by_features(transformed)
        totals = (self.inverse @ self.ones[..., None])[..., 0] * self.ones
        self.inverse_total = totals.sum(axis=1)
        self.share = totals / self.inverse_total[:, None]

    def _invert_by_matches(self, transformed: FloatArray, pairs: FloatArray) -> None:
        """Invert ``diag(s / x) + (b_i^T (W * b_h b_h^T) b_i)_hi``, and keep a root of the inverse."""
        k, c, size = transformed.shape
        columns = np.ascontiguousarray(np.swapaxes(transformed, 1, 2))
        dense = (pairs.reshape(k, c * size, size) @ columns).reshape(k, c, size, c)
        dense *= columns[:, None]
        response = dense.sum(axis=2)
        diagonal = np.arange(c)
        response[:, diagonal, diagonal] += 1.0 / self.conductance
        self.root: FloatArray | None = np.linalg.inv(np.linalg.cholesky(response)).astype(np.float64, copy=False)
        self.inverse: FloatArray = np.swapaxes(self.root, 1, 2) @ self.root

    def _invert_by_features(self, transformed: FloatArray) -> None:
        """Invert the same matrix where there are more matches than coordinates (Woodbury)."""
        basis = self.basis
        root = np.sqrt(self.W.reshape(len(self.W), 1, -1).take(basis.flat, axis=2)) * basis.scale
        features = transformed.take(basis.rows, axis=2) * transformed.take(basis.cols, axis=2)
        features *= root
        weighted = self.conductance[..., None] * features
        inner = np.swapaxes(features, 1, 2) @ weighted
        diagonal = np.arange(inner.shape[1])
        inner[:, diagonal, diagonal] += 1.0
        half = np.linalg.inv(np.linalg.cholesky(inner)) @ np.swapaxes(weighted, 1, 2)
        inverse: FloatArray = -np.swapaxes(half, 1, 2) @ half
        matches = np.arange(inverse.shape[1])
        inverse[:, matches, matches] += self.conductance
        self.root, self.inverse = None, inverse

    def _quaternion_operators(self) -> None:
        """Diagonalise ``X -> sym(Y_dual^-1 X Y_primal)`` on symmetric 4x4 matrices, one per rotation block."""
        self.quaternion_maps = []
        for primal, dual in zip(self.primal.Y, self.dual.Y, strict=True):
            factor = np.linalg.cholesky(dual)
            eigenvalues, vectors = np.linalg.eigh(factor.T @ primal @ factor)
            eigenvalues = np.maximum(eigenvalues, _TINY)
            weights = 2.0 / (eigenvalues[:, None] + eigenvalues)
            self.quaternion_maps.append((vectors.T @ factor.T, weights))

    def _assemble(self) -> None:
        """Form and factor the reduced system."""
        data, basis = self.data, self.basis
        num = basis.num_coordinates
        totals = self.share * self.inverse_total[:, None]
        moments = basis.congruence_sum(self.T, self.eigenvalues)
        if self.root is None:
            reactions = self.inverse @ self.moves
            reactions -= self.share[..., None] * (totals[:, None, :] @ self.moves)
            moments -= self.moves.reshape(-1, num).T @ reactions.reshape(-1, num)
        else:
            halves = self.root @ self.moves
            direction = self.root @ (self.ones / np.sqrt(self.inverse_total)[:, None])[..., None]
            halves -= direction @ (np.swapaxes(direction, 1, 2) @ halves)
            reactions = np.swapaxes(self.root, 1, 2) @ halves
            flat = halves.reshape(-1, num)
            moments -= gram(flat, coarse=basis.is_coarse)
        means = slice(0, data.lifted.num_variables)
        for (_, slopes), (T, weights) in zip(data.lifted.quaternion_blocks, self.quaternion_maps, strict=True):
            transformed = ((T @ slopes @ T.T) * np.sqrt(weights)).reshape(-1, 16)
            moments[means, means] += 0.5 * transformed @ transformed.T
        coupling = data.row_sums(reactions)
        coupling[data.pinned] = 0.0
        self.coupling = basis.reduce_columns(coupling.T)
        self.rows_factor = _factor(self._row_matrix(totals))
        schur = basis.reduce_operator(moments)
        schur += self.coupling @ cho_solve(self.rows_factor, self.coupling.T, check_finite=False)
        self.schur_factor = _factor(schur)

    def _row_matrix(self, totals: FloatArray) -> FloatArray:
        """Return the (n, n) matrix of the row sums, one row of each closed component pinned."""
        data = self.data
        if data.is_complete:
            rows = self.inverse.sum(axis=0) - self.share.T @ totals
        else:
            response = self.inverse - self.share[:, :, None] * totals[:, None, :]
            response *= self.ones[:, :, None] * self.ones[:, None, :]
            rows = np.bincount(data.row_pairs, response.ravel(), data.num_rows**2)
            rows = rows.astype(np.float64, copy=False).reshape(data.num_rows, -1)
        open_rows = np.flatnonzero(~data.equality)
        rows[open_rows, open_rows] -= self.primal.slack[open_rows] / self.dual.beta[open_rows]
        pinned = data.pinned
        rows[pinned], rows[:, pinned] = 0.0, 0.0
        rows[pinned, pinned] = 1.0
        return rows

    def solve(self, targets: Targets) -> Direction:
        """Solve for all variables, refining where the reduced system is inexact."""
        data, basis = self.data, self.basis
        num_rows = data.num_rows
        coordinates, dbeta = np.zeros(basis.num_coordinates), np.zeros(num_rows)
        pushes = targets.products / self._safe_x()
        acceptable = 0.0
        for refinement in range(_MAX_REFINEMENTS + 2):
            moments = basis.unpack(coordinates)
            dx, local = self._local(targets.moments - moments, pushes + dbeta[data.index])
            imbalance = basis.reduce(self._imbalance(targets, local, moments))
            row_rhs = self._row_residual(targets, dx, dbeta)
            error = max(float(np.abs(imbalance).max(initial=0.0)), float(np.abs(row_rhs).max()))
            if error <= acceptable or refinement > _MAX_REFINEMENTS:
                break
            acceptable = _REFINEMENT_TOL * error if refinement == 0 else acceptable
            rhs = imbalance + self.coupling @ cho_solve(self.rows_factor, row_rhs, check_finite=False)
            step = cho_solve(self.schur_factor, rhs, check_finite=False)
            dbeta = dbeta + cho_solve(self.rows_factor, row_rhs - self.coupling.T @ step, check_finite=False)
            coordinates = coordinates + basis.expand(step)
        return self._direction(targets, dx, local, moments, dbeta)

    def _imbalance(self, targets: Targets, local: FloatArray, moments: FloatArray) -> FloatArray:
        """Return the sum of the new u and F of all points, in coordinates: it must be spanned by the equations."""
        imbalance = self.basis.pack(local.sum(axis=0) + self._dual_sum())
        means = slice(0, self.data.lifted.num_variables)
        for index, (_, slopes) in enumerate(self.data.lifted.quaternion_blocks):
            change = targets.quaternions[index] - along(moments[0, 1:], slopes)
            dY = self._quaternion_solve(index, change) + self.dual.Y[index]
            imbalance[means] += _ROOT_HALF * (slopes.reshape(-1, 16) @ dY.ravel())
        return imbalance

    def _row_residual(self, targets: Targets, dx: FloatArray, dbeta: FloatArray) -> FloatArray:
        """Return what the rows' new sums, their new slack included, miss of the capacities."""
        data, primal = self.data, self.primal
        residual = data.capacity - data.row_sums(primal.x + dx) - primal.slack
        open_rows = ~data.equality
        change = targets.slacks[open_rows] + primal.slack[open_rows] * dbeta[open_rows]
        residual[open_rows] += change / self.dual.beta[open_rows]
        residual[data.pinned] = 0.0
        return residual

    def _safe_x(self) -> FloatArray:
        return self.primal.x if self.data.is_full else np.where(self.data.valid, self.primal.x, 1.0)

    def _dual_sum(self) -> FloatArray:
        """Return ``sum_j [[0, u_j^T], [u_j, F_j]]``, which must be a combination of the equations."""
        dual = self.dual
        total = np.zeros(self.T.shape[1:])
        total[1:, 1:] = dual.F.sum(axis=0)
        total[1:, 0] = total[0, 1:] = dual.u.sum(axis=0)
        return total

    def _local(self, rhs: FloatArray, push: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dx and Delta of every point for given right hand sides of its own two equations."""
        T, T_t = self.T, self.T_t
        base = T_t @ (self.W * (T @ rhs @ T_t)) @ T
        push = (push - ((self.lifted @ base) * self.lifted).sum(axis=2)) * self.ones
        missing = -rhs[:, 0, 0]
        pushed = (self.inverse @ push[..., None])[..., 0]
        excess = pushed.sum(axis=1) - missing
        dx = pushed - self.share * excess[:, None]
        gathered = np.swapaxes(dx[..., None] * self.lifted, 1, 2) @ self.lifted
        local = base + T_t @ (self.W * (T @ gathered @ T_t)) @ T
        local[:, 0, 0] += excess / self.inverse_total
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
            self._quaternion_solve(i, targets.quaternions[i] - along(dR, slopes))
            for i, (_, slopes) in enumerate(data.lifted.quaternion_blocks)
        )
        dslack = np.zeros(data.num_rows)
        open_rows = ~data.equality
        dslack[open_rows] = (targets.slacks[open_rows] + primal.slack[open_rows] * dbeta[open_rows]) / -dual.beta[
            open_rows
        ]
        return Direction(dx, dB, moments[1:, 1:], dR, dslack, dalpha, dbeta, dF, du, dY)


def _factor(matrix: FloatArray) -> tuple[FloatArray, bool]:
    return cho_factor(matrix, lower=True, check_finite=False)
