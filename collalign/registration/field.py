"""Smooth displacements of space: sums of Gaussians around centres, of several widths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray

#: Points whose kernels are in memory at a time.
_BLOCK = 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class SmoothField:
    """A displacement ``u(x) = sum_c k(x, c) w_c`` with ``k(x, c) = sum_s a_s^2 exp(-|x - c|^2 / (2 s^2))``.

    Attributes
    ----------
    centres : ndarray, shape (m, 3)
    weights : ndarray, shape (m, 3)
    widths, amplitudes : tuple of float
        Of the kernel's terms, in the unit of the centres.

    References
    ----------
    Lüthi, Gerig, Jud and Vetter, Gaussian process morphable models, IEEE PAMI 40 (2018): sums of kernels as a
    prior of deformations of several scales.
    """

    centres: FloatArray
    weights: FloatArray
    widths: tuple[float, ...]
    amplitudes: tuple[float, ...]

    @property
    def bending(self) -> float:
        """Squared norm of the displacement in the kernel's space: how unlikely the prior finds it."""
        kernel = gaussian_kernel(self.centres, self.centres, self.widths, self.amplitudes)
        return float((self.weights * (kernel @ self.weights)).sum())

    def moved(self, points: FloatArray) -> FloatArray:
        """Return points where the field takes them, shape (q, 3)."""
        blocks = [
            block + gaussian_kernel(block, self.centres, self.widths, self.amplitudes) @ self.weights
            for block in _blocks(points)
        ]
        return np.concatenate(blocks) if blocks else np.array(points)

    def slope_kernel(self, points: FloatArray) -> FloatArray:
        """Return ``sum_s a_s^2 / s^2 exp(...)``, shape (q, m): the kernel's gradient is ``-(x - c)`` times that."""
        scaled = tuple(a / s for a, s in zip(self.amplitudes, self.widths, strict=True))
        return gaussian_kernel(points, self.centres, self.widths, scaled)

    def jacobian(self, points: FloatArray, kernel: FloatArray) -> FloatArray:
        """Return ``d(x + u)_i / dx_j``, shape (q, 3, 3), given the points' slope kernel."""
        outer = self.weights[:, :, None] * self.centres[:, None, :]
        toward = (kernel @ outer.reshape(len(outer), 9)).reshape(-1, 3, 3)
        away = (kernel @ self.weights)[:, :, None] * points[:, None, :]
        return np.asarray(np.eye(3) + toward - away)


def gaussian_kernel(
    points: FloatArray, centres: FloatArray, widths: tuple[float, ...], amplitudes: tuple[float, ...]
) -> FloatArray:
    """Return the kernel of points and centres, shape (q, m)."""
    squares = (points**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * points @ centres.T
    np.maximum(squares, 0.0, out=squares)
    total = np.zeros_like(squares)
    for width, amplitude in zip(widths, amplitudes, strict=True):
        total += amplitude**2 * np.exp(squares / (-2.0 * width**2))
    return total


def _blocks(points: FloatArray) -> list[FloatArray]:
    return [points[start : start + _BLOCK] for start in range(0, len(points), _BLOCK)]
