"""The Newton system of the interior-point method, eliminated point by point.

In terms of ``Delta_j = [[-d alpha_j, d u_j^T], [d u_j, d F_j]]``, ``b = (1, F^-1 w)``, ``m = (1, B / x)``,
``E = diag(0, F^-1)`` and ``H_j = sum_i x_i m_i m_i^T + diag(0, G_j) / 2``, every source point contributes

    H Delta E + E Delta H - sum_i dx_i b_i b_i^T + dM = rhs_j                 (moments; HKM scaling of F G = mu I)
    dx_i = rho_i / s_i - (x_i / s_i) (b_i^T Delta b_i - d beta_i)             (complementarity x s = mu)

and the points meet in ``sum_j Delta_j = sum_m dy_m A_m`` and in the row sums of x. In a tied row i a step of g adds
``x_i sym(m_i (0, F^-1 d g_i)^T)`` twice to the first equation and ``d g_i`` to d u_j in the second; with ``d g_i =
-e_i / 2`` it pushes a match as ``d beta_i`` does, by ``b_i^T (d beta_i, e_i)``. One generalised eigendecomposition
of (H, F^-1) per point turns the first operator into a diagonal one; the matches are a term of low rank in it.
What remains is a positive definite system in the moments dM (within the null space of the equations), d beta and e.
"""

from __future__ import annotations

import numpy as np
import scipy

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.moment_basis import MomentBasis, gram
from pairwise.pm_sdp.newton_blocks import TINY, LocalBlocks
from pairwise.pm_sdp.steps import Targets
from pairwise.pm_sdp.variables import Direction, DualPoint, PrimalPoint

#: Most refinements of a solution of the reduced system.
_MAX_REFINEMENTS = 3

#: A solution is refined until its residual is this share of the right hand side.
_REFINEMENT_TOL = 1e-6


class NewtonSystem:
    """Factorisation of the Newton system at one pair of primal and dual points.

    Raises
    ------
    TimeoutError
        If the deadline, on the clock of ``time.perf_counter``, passes before it is assembled.
    """

    def __init__(
        self,
        data: RelaxationData,
        basis: MomentBasis,
        primal: PrimalPoint,
        dual: DualPoint,
        deadline: float = np.inf,
    ) -> None:
        self.data, self.basis, self.primal, self.dual = data, basis, primal, dual
        self.blocks = LocalBlocks(data, basis, primal, dual)
        self.quaternion_operators = _quaternion_operators(primal.Y, dual.Y)
        self.dual_sum = basis.sum_of_points(data.lifted, dual.F, dual.u, dual.g, dual.Y)
        self.pinned = np.concatenate(
            [data.pinned, np.repeat(data.pinned[data.tied], data.lifted.num_variables)]
        )
        self._assemble(deadline)

    def _assemble(self, deadline: float) -> None:
        """Form and factor the reduced system."""
        data, basis = self.data, self.basis
        moments, coupling, rows = self.blocks.condense(deadline)
        means = slice(0, data.lifted.num_variables)
        for slopes, T, weights in zip(
            data.lifted.quaternion_slopes, *self.quaternion_operators, strict=True
        ):
            transformed = ((T @ slopes @ T.T) * np.sqrt(weights)).reshape(-1, 16)
            moments[means, means] += 0.5 * transformed @ transformed.T
        open_rows = np.flatnonzero(~data.equality)
        rows[open_rows, open_rows] -= self.primal.slack[open_rows] / self.dual.beta[open_rows]
        rows[self.pinned], rows[:, self.pinned], coupling[self.pinned] = 0.0, 0.0, 0.0
        rows[self.pinned, self.pinned] = 1.0
        coupling = basis.reduce_columns(coupling.T)
        self.rows_factor = _factor(rows)
        half = _solve_lower(self.rows_factor, coupling.T)
        schur = basis.reduce_operator(moments)
        schur += gram(half)
        self.coupling = coupling
        self.schur_factor = _factor(schur)

    def solve(self, targets: Targets) -> Direction:
        """Solve for all variables, refining what rounding left."""
        data, basis = self.data, self.basis
        coordinates, potentials = np.zeros(basis.num_coordinates), np.zeros(len(self.pinned))
        pushes = targets.products / (
            self.primal.x if data.is_full else np.where(data.valid, self.primal.x, 1.0)
        )
        acceptable = 0.0
        for refinement in range(_MAX_REFINEMENTS + 2):
            moments = basis.unpack(coordinates)
            dbeta, dg = self._row_steps(potentials)
            rotated, pushed = self._of_rows(dbeta, dg)
            dx, local = self.blocks.solve(targets.moments - moments - rotated, pushes + pushed)
            imbalance = basis.reduce(self._imbalance(targets, local, dg, moments))
            row_rhs = self._row_residual(targets, dx, local, dbeta, dg, moments)
            error = max(float(np.abs(imbalance).max(initial=0.0)), float(np.abs(row_rhs).max()))
            if error <= acceptable or refinement > _MAX_REFINEMENTS:
                break
            if refinement == 0:
                acceptable = _REFINEMENT_TOL * error
            rhs = imbalance + self.coupling @ _solve(self.rows_factor, row_rhs)
            step = _solve(self.schur_factor, rhs)
            potentials = potentials + _solve(self.rows_factor, row_rhs - self.coupling.T @ step)
            coordinates = coordinates + basis.expand(step)
        return self._direction(targets, dx, local, moments, dbeta, dg)

    def _row_steps(self, potentials: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return d beta (n,) and d g (n, s) of the unknowns of the rows."""
        data = self.data
        dbeta, dg = (
            potentials[: data.num_rows],
            np.zeros((data.num_rows, data.lifted.num_variables)),
        )
        dg[data.tied] = -0.5 * potentials[data.num_rows :].reshape(-1, dg.shape[1])
        return dbeta, dg

    def _of_rows(self, dbeta: FloatArray, dg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what steps of the rows add to the moment equations (k, s+1, s+1), and their push (k, c)."""
        data, primal, dual = self.data, self.primal, self.dual
        rotated, pushed = np.zeros(self.blocks.T.shape), dbeta[data.index]
        if data.tied.any():
            shift = dg[data.index]
            pushed -= 2.0 * (dual.mean * shift).sum(axis=2)
            solved = shift @ dual.inverse
            rotated[:, 0, 1:] = rotated[:, 1:, 0] = (primal.x[:, None] @ solved)[:, 0]
            mixed = np.swapaxes(primal.B, 1, 2) @ solved
            rotated[:, 1:, 1:] = mixed + np.swapaxes(mixed, 1, 2)
        return rotated, pushed

    def _imbalance(
        self, targets: Targets, local: FloatArray, dg: FloatArray, moments: FloatArray
    ) -> FloatArray:
        """Return the sum of the new u, g and F, in coordinates: it must be spanned by the equations."""
        dY = self._quaternion_step(targets, moments[0, 1:])
        step = self.basis.sum_of_points(self.data.lifted, local[:, 1:, 1:], local[:, 1:, 0], dg, dY)
        return step + self.dual_sum

    def _row_residual(
        self,
        targets: Targets,
        dx: FloatArray,
        local: FloatArray,
        dbeta: FloatArray,
        dg: FloatArray,
        moments: FloatArray,
    ) -> FloatArray:
        """Return what the rows' new sums, their new slack included, miss of the capacities, and of R in tied rows."""
        data, primal = self.data, self.primal
        residual = 1.0 - data.row_sums(primal.x + dx) - primal.slack
        open_rows = ~data.equality
        change = targets.slacks[open_rows] + primal.slack[open_rows] * dbeta[open_rows]
        residual[open_rows] += change / self.dual.beta[open_rows]
        if data.tied.any():
            sums = data.row_sums(primal.B + self._step_of_B(targets, dx, local, dg))[data.tied]
            residual = np.concatenate([residual, (primal.R + moments[0, 1:] - sums).ravel()])
        residual[self.pinned] = 0.0
        return residual

    def _step_of_B(
        self, targets: Targets, dx: FloatArray, local: FloatArray, dg: FloatArray
    ) -> FloatArray:
        """Return dB (k, c, s) of a step of the other variables."""
        primal, dual = self.primal, self.dual
        shift = local[:, None, 1:, 0] + dg[self.data.index]
        pull = primal.B @ local[:, 1:, 1:] + primal.x[..., None] * shift - targets.ratio
        step: FloatArray = dx[..., None] * dual.mean - pull @ dual.inverse
        return step

    def _quaternion_step(self, targets: Targets, dR: FloatArray) -> FloatArray:
        """Return dY (q, 4, 4) of the dual point for a step of R."""
        T, weights = self.quaternion_operators
        rhs = targets.quaternions - self.data.lifted.quaternion_change(dR)
        transposed = np.swapaxes(T, 1, 2)
        return transposed @ ((T @ rhs @ transposed) * weights) @ T

    def _direction(
        self,
        targets: Targets,
        dx: FloatArray,
        local: FloatArray,
        moments: FloatArray,
        dbeta: FloatArray,
        dg: FloatArray,
    ) -> Direction:
        data, primal, dual = self.data, self.primal, self.dual
        dF, du = local[:, 1:, 1:], local[:, 1:, 0]
        rotated, shift = dual.mean @ dF, du[:, None] + dg[data.index]
        bend, ds = -shift - rotated, ((rotated + 2.0 * shift) * dual.mean).sum(axis=2)
        dB = self._step_of_B(targets, dx, local, dg)
        dR, dalpha = moments[0, 1:], -local[:, 0, 0]
        dY = self._quaternion_step(targets, dR)
        dslack = np.zeros(data.num_rows)
        open_rows = ~data.equality
        change = targets.slacks[open_rows] + primal.slack[open_rows] * dbeta[open_rows]
        dslack[open_rows] = change / -dual.beta[open_rows]
        ds -= dalpha[:, None] + dbeta[data.index]
        return Direction(
            dx, dB, moments[1:, 1:], dR, dslack, dalpha, dbeta, dF, du, dg, dY, bend, ds
        )


def _factor(matrix: FloatArray) -> FloatArray:
    """Return the lower Cholesky factor."""
    factor, info = scipy.linalg.lapack.dpotrf(matrix, lower=True)
    if info != 0:
        raise np.linalg.LinAlgError("not positive definite")
    return factor


def _solve(factor: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve a system whose lower Cholesky factor is given."""
    return scipy.linalg.lapack.dpotrs(factor, rhs, lower=True)[0]


def _solve_lower(factor: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve a lower triangular system of several right hand sides."""
    return scipy.linalg.lapack.dtrtrs(factor, rhs, lower=True)[0]


def _quaternion_operators(primal: FloatArray, dual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Diagonalise ``X -> sym(dual^-1 X primal)`` of 4x4 matrices: T and W with ``T^T (W * (T . T^T)) T``."""
    factor = np.linalg.cholesky(dual)
    values, vectors = np.linalg.eigh(np.swapaxes(factor, 1, 2) @ primal @ factor)
    values = np.maximum(values, TINY)
    return np.swapaxes(factor @ vectors, 1, 2), 2.0 / (values[:, :, None] + values[:, None, :])
