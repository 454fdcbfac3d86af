"""Coordinates of the moment matrix and the null space of its equations."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from pairwise.pm_sdp.lifted_rotation import LiftedRotation


def gram(rows: FloatArray) -> FloatArray:
    """Return ``rows^T rows`` (q, q) of rows (p, q)."""
    product: FloatArray = rows.T @ rows
    return product


def cauchy_factors(values: FloatArray) -> list[FloatArray]:
    """Return narrow F_j (s, r) with F_j F_j^T = ``1 / (values_ja + values_jb)`` to rounding, for values (K, s) > 0.

    Cholesky's factorization with pivots of that matrix, scaled to a unit diagonal. It ends early: singular values of
    Cauchy's matrices decay geometrically (Beckermann and Townsend 2017).
    """
    roots = np.sqrt(2.0 * values)[..., None]
    scaled = roots * np.swapaxes(roots, 1, 2) / (values[..., None] + values[:, None])
    factors = []
    for matrix, root in zip(np.triu(scaled), roots, strict=True):
        lower, pivots, rank, _ = scipy.linalg.lapack.dpstrf(matrix.T, lower=1)
        factor = np.empty((len(root), rank))
        factor[pivots - 1] = lower[:, :rank]
        factors.append(factor / root)
    return factors


class MomentBasis:
    """Orthonormal coordinates of symmetric (s+1, s+1) matrices without their (0, 0) entry.

    Parameters
    ----------
    size : int
        s.
    equations : ndarray, shape (e, s+1, s+1)
        Linearly independent ``A_m``, one at least; directions in the moment matrix satisfy ``<A_m, direction> = 0``.
    """

    def __init__(self, size: int, equations: FloatArray) -> None:
        self.size = size
        rows, cols = np.triu_indices(size + 1)
        self._all_rows, self._all_cols = rows, cols
        self.rows, self.cols = rows[1:], cols[1:]
        self._all_flat = rows * (size + 1) + cols
        self.flat = self.rows * (size + 1) + self.cols
        self._position = np.zeros((size + 1, size + 1), dtype=np.int64)
        self._position[self.rows, self.cols] = self._position[self.cols, self.rows] = np.arange(
            len(self.rows)
        )
        self.scale = np.where(self.rows == self.cols, 1.0, np.sqrt(2.0))
        self.num_equations = len(equations)
        self.constants = equations[:, 0, 0]
        packed = np.asfortranarray(self.pack(equations).T)
        self._reflectors, self._tau, _, _ = scipy.linalg.lapack.dgeqrf(packed)

    @property
    def num_coordinates(self) -> int:
        """Number of coordinates, (s+1)(s+2)/2 - 1."""
        return len(self.rows)

    def pack(self, matrices: FloatArray) -> FloatArray:
        """Return the coordinates (..., m) of symmetric matrices; inner products without (0, 0) are kept."""
        flat = matrices.reshape(*matrices.shape[:-2], (self.size + 1) ** 2)
        packed: FloatArray = flat.take(self.flat, axis=-1)
        packed *= self.scale
        return packed

    def unpack(self, coordinates: FloatArray) -> FloatArray:
        """Return the symmetric matrices (..., s+1, s+1) whose (0, 0) entry is zero."""
        matrices: FloatArray = (coordinates / self.scale).take(self._position, axis=-1)
        matrices[..., 0, 0] = 0.0
        return matrices

    def sum_of_points(
        self, lifted: LiftedRotation, F: FloatArray, u: FloatArray, g: FloatArray, Y: FloatArray
    ) -> FloatArray:
        """Return the coordinates (m,) of what the equations must span: sums of F, u and g, and the part of Y.

        Parameters
        ----------
        lifted : LiftedRotation
        F, u, g, Y : ndarray, shapes (k, s, s), (k, s), (n, s) and (q, 4, 4)
            Of a dual point or of a step.
        """
        total = np.zeros((self.size + 1, self.size + 1))
        total[0, 1:] = (
            u.sum(axis=0)
            + g.sum(axis=0)
            + 0.5 * np.einsum("qaij,qij->a", lifted.quaternion_slopes, Y)
        )
        total[1:, 1:] = F.sum(axis=0)
        return self.pack(total)

    @cached_property
    def congruence_gather(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Where the pair products (ac, bd) and (ad, bc) of an operator stand, and the factor of each side."""
        num = len(self._all_rows)
        position = np.zeros((self.size + 1, self.size + 1), dtype=np.int64)
        position[self._all_rows, self._all_cols] = np.arange(num)
        position[self._all_cols, self._all_rows] = np.arange(num)
        a, b, c, d = self.rows[:, None], self.cols[:, None], self.rows, self.cols
        first = position[a, c] * num + position[b, d]
        second = position[a, d] * num + position[b, c]
        half = np.where(self.rows == self.cols, np.sqrt(0.5), 1.0)
        return first, second, half

    def congruence_sum(self, T: FloatArray, eigenvalues: FloatArray) -> FloatArray:
        """Return the matrix (m, m) of ``X -> sum_j T_j^T (W_j * (T_j X T_j^T)) T_j``.

        W_ab is 1 / (lambda_a + lambda_b) for a, b >= 1, W_0b = 1 and W_00 = 0. Costs O(K r s^4) for r the numerical
        rank of W, 8 to 18 where s is 79: the Gram matrix of pair products of T, which a factor of W combines.

        Parameters
        ----------
        T : ndarray, shape (K, s+1, s+1)
            Row 0 is zero but for its first entry.
        eigenvalues : ndarray, shape (K, s)
            Positive lambda_1, ..., lambda_s.
        """
        combined = [
            factor.T @ (rows.take(self._all_rows, axis=1) * rows.take(self._all_cols, axis=1))
            for factor, rows in zip(cauchy_factors(eigenvalues), T[:, 1:], strict=True)
        ]
        operator = gram(np.concatenate(combined))
        first_row = (T[:, 0, 0] ** 2) @ (np.swapaxes(T[:, 1:], 1, 2) @ T[:, 1:]).reshape(len(T), -1)
        first_row = first_row[self._all_flat]
        operator[0] += first_row
        operator[:, 0] += first_row
        first, second, half = self.congruence_gather
        result: FloatArray = operator.take(first)
        result += operator.take(second)
        result *= half[:, None]
        result *= half
        return result

    def reduce(self, coordinates: FloatArray) -> FloatArray:
        """Return the coordinates (m,) of a vector within the null space of the equations."""
        return self._rotate(coordinates[:, None], "T")[self.num_equations :, 0]

    def expand(self, reduced: FloatArray) -> FloatArray:
        """Return the vector (m,) of the null space with these coordinates."""
        padded = np.concatenate([np.zeros(self.num_equations), reduced])
        return self._rotate(padded[:, None], "N")[:, 0]

    def reduce_operator(self, operator: FloatArray) -> FloatArray:
        """Return a symmetric (m, m) operator, whose storage is used, restricted to the null space."""
        half = self._rotate(operator.T, "T", overwrite=True)
        rotated = self._rotate(half, "N", side="R", overwrite=True)
        return rotated[self.num_equations :, self.num_equations :]

    def reduce_columns(self, columns: FloatArray) -> FloatArray:
        """Return :meth:`reduce` of the columns of an (m, p) array."""
        return self._rotate(columns, "T")[self.num_equations :]

    def split(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return y (e,) such that ``sum_m y_m A_m`` is nearest to a vector (m,), and the vector's other part."""
        rotated = self._rotate(coordinates[:, None], "T")[:, 0]
        inside, outside = rotated[: self.num_equations], rotated[self.num_equations :]
        return scipy.linalg.lapack.dtrtrs(self._reflectors[: self.num_equations], inside)[
            0
        ], outside

    def correction(self, violations: FloatArray) -> FloatArray:
        """Return the shortest vector (m,) with ``<A_m, vector> = violations_m``."""
        padded = np.zeros(self.num_coordinates)
        padded[: self.num_equations] = scipy.linalg.solve_triangular(
            self._reflectors[: self.num_equations], violations, trans="T"
        )
        return self._rotate(padded[:, None], "N")[:, 0]

    def _rotate(
        self, columns: FloatArray, trans: str, *, side: str = "L", overwrite: bool = False
    ) -> FloatArray:
        """Apply the Householder reflections of the equations' QR factorisation."""
        lwork = 64 * max(columns.shape)
        rotated, _, info = scipy.linalg.lapack.dormqr(
            side, trans, self._reflectors, self._tau, columns, lwork, overwrite_c=overwrite
        )
        if info != 0:
            raise ArithmeticError(f"ormqr returned {info}")
        return rotated
