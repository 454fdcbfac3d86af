"""Coordinates of the moment matrix and the null space of its equations."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.linalg import lapack, solve_triangular

from data_tools.arrays import FloatArray, IntArray


class MomentBasis:
    """Orthonormal coordinates of symmetric (s+1, s+1) matrices without their (0, 0) entry.

    Parameters
    ----------
    size : int
        s.
    equations : ndarray, shape (e, s+1, s+1)
        Linearly independent ``A_m``; directions in the moment matrix satisfy ``<A_m, direction> = 0``.
    """

    def __init__(self, size: int, equations: FloatArray) -> None:
        self.size = size
        rows, cols = np.triu_indices(size + 1)
        self._all_rows, self._all_cols = rows, cols
        self.rows, self.cols = rows[1:], cols[1:]
        self.flat = self.rows * (size + 1) + self.cols
        self.scale = np.where(self.rows == self.cols, 1.0, np.sqrt(2.0))
        self.num_equations = len(equations)
        self.constants = equations[:, 0, 0]
        packed = np.asfortranarray(self.pack(equations).T)
        if self.num_equations:
            self._reflectors, self._tau, _, _ = lapack.dgeqrf(packed)

    @property
    def num_coordinates(self) -> int:
        """Number of coordinates, (s+1)(s+2)/2 - 1."""
        return len(self.rows)

    def pack(self, matrices: FloatArray) -> FloatArray:
        """Return the coordinates (..., m) of symmetric matrices; inner products without (0, 0) are kept."""
        return matrices[..., self.rows, self.cols] * self.scale

    def unpack(self, coordinates: FloatArray) -> FloatArray:
        """Return the symmetric matrices (..., s+1, s+1) whose (0, 0) entry is zero."""
        matrices = np.zeros((*coordinates.shape[:-1], self.size + 1, self.size + 1))
        matrices[..., self.rows, self.cols] = coordinates / self.scale
        matrices[..., self.cols, self.rows] = matrices[..., self.rows, self.cols]
        return matrices

    @cached_property
    def congruence_gather(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Where the pair products (ac, bd) and (ad, bc) of an operator stand, and the factor of each entry."""
        num = len(self._all_rows)
        position = np.zeros((self.size + 1, self.size + 1), dtype=np.int64)
        position[self._all_rows, self._all_cols] = np.arange(num)
        position[self._all_cols, self._all_rows] = np.arange(num)
        a, b, c, d = self.rows[:, None], self.cols[:, None], self.rows, self.cols
        first = position[a, c] * num + position[b, d]
        second = position[a, d] * num + position[b, c]
        half = np.where(self.rows == self.cols, np.sqrt(0.5), 1.0)
        return first, second, np.outer(half, half)

    def congruence_sum(self, T: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the matrix (m, m) of ``X -> sum_j T_j^T (W_j * (T_j X T_j^T)) T_j``.

        Costs O(K s^5) for K terms: pair products of T on one side, weighted Gram matrices on the other.

        Parameters
        ----------
        T : ndarray, shape (K, s+1, s+1)
        weights : ndarray, shape (K, s+1, s+1)
            Symmetric W_j.
        """
        rows, cols = self._all_rows, self._all_cols
        num = len(rows)
        products = (T[:, :, rows] * T[:, :, cols]).reshape(-1, num)
        grams = (np.swapaxes(T, 1, 2)[:, None] * weights[:, :, None, :]) @ T[:, None]
        operator = (products.T @ grams[:, :, rows, cols].reshape(-1, num)).ravel()
        first, second, factor = self.congruence_gather
        return (operator[first] + operator[second]) * factor

    def reduce(self, coordinates: FloatArray) -> FloatArray:
        """Return the coordinates (m,) of a vector within the null space of the equations."""
        return self._rotate(coordinates[:, None], "T")[self.num_equations :, 0]

    def expand(self, reduced: FloatArray) -> FloatArray:
        """Return the vector (m,) of the null space with these coordinates."""
        padded = np.concatenate([np.zeros(self.num_equations), reduced])
        return self._rotate(padded[:, None], "N")[:, 0]

    def reduce_operator(self, operator: FloatArray) -> FloatArray:
        """Return a symmetric (m, m) operator restricted to the null space."""
        half = self._rotate(operator, "T")[self.num_equations :]
        return self._rotate(np.ascontiguousarray(half.T), "T")[self.num_equations :]

    def reduce_columns(self, columns: FloatArray) -> FloatArray:
        """Return :meth:`reduce` of the columns of an (m, p) array."""
        return self._rotate(columns, "T")[self.num_equations :]

    def split(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return y (e,) such that ``sum_m y_m A_m`` is nearest to a vector (m,), and the vector's other part."""
        rotated = self._rotate(coordinates[:, None], "T")[:, 0]
        inside, outside = rotated[: self.num_equations], rotated[self.num_equations :]
        if self.num_equations == 0:
            return inside, outside
        return solve_triangular(self._reflectors[: self.num_equations], inside, check_finite=False), outside

    def correction(self, violations: FloatArray) -> FloatArray:
        """Return the shortest vector (m,) with ``<A_m, vector> = violations_m``."""
        padded = np.zeros(self.num_coordinates)
        if self.num_equations:
            padded[: self.num_equations] = solve_triangular(
                self._reflectors[: self.num_equations], violations, trans="T"
            )
        return self._rotate(padded[:, None], "N")[:, 0]

    def _rotate(self, columns: FloatArray, trans: str) -> FloatArray:
        """Apply the Householder reflections of the equations' QR factorisation."""
        if self.num_equations == 0:
            return columns
        lwork = 64 * max(columns.shape[1], 1)
        rotated, _, info = lapack.dormqr("L", trans, self._reflectors, self._tau, columns, lwork)
        if info != 0:
            raise ArithmeticError(f"dormqr returned {info}")
        return rotated
