"""Primal and dual iterates of the interior-point method, with the quantities that the Newton system needs.

The cone of one source point couples its matches' probabilities ``x``, the vectors ``B`` and the shared moments ``C``:
``C - sum_i B_i B_i^T / x_i`` is positive definite. Its dual couples ``F``, ``w = v - u`` and the slacks:
``s = cost - alpha - beta - w^T F^-1 w`` is positive. Both live here; a point outside its cone is ``None``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.relaxation import RelaxationData


@dataclass(frozen=True, eq=False)
class PrimalPoint:
    """Variables of the relaxation inside their cones.

    Attributes
    ----------
    x : ndarray, shape (k, c)
        Probability of each match; zero where padded.
    B : ndarray, shape (k, c, s)
        x times the conditional mean of rho.
    C, R : ndarray, shapes (s, s) and (s,)
        Second and first moments of rho.
    slack : ndarray, shape (n,)
        Unused capacity of each row.
    mean : ndarray, shape (k, c, s)
        B / x.
    G : ndarray, shape (k, s, s)
        C - sum_i B_i B_i^T / x_i, positive definite.
    Y : tuple of ndarray (4, 4)
        Quaternion moments of each rotation block.
    inverse_factor : ndarray, shape (k, s, s)
        Inverse of the Cholesky factor of G.
    """

    x: FloatArray
    B: FloatArray
    C: FloatArray
    R: FloatArray
    slack: FloatArray
    mean: FloatArray
    G: FloatArray
    Y: tuple[FloatArray, ...]
    inverse_factor: FloatArray


@dataclass(frozen=True, eq=False)
class DualPoint:
    """Multipliers inside their cones.

    Attributes
    ----------
    alpha, beta : ndarray, shapes (k,) and (n,)
        Potentials of the assignment; beta <= 0 where the row sum is an inequality.
    F, u : ndarray, shapes (k, s, s) and (k, s)
        Multipliers of each source point.
    Y : tuple of ndarray (4, 4)
        Multipliers of conv SO(3).
    factor, inverse_factor, inverse : ndarray, shape (k, s, s)
        Cholesky factor of F, its inverse, inverse of F.
    w : ndarray, shape (k, c, s)
        v - u.
    mean : ndarray, shape (k, c, s)
        F^-1 w.
    s : ndarray, shape (k, c)
        Slack of every match; one where padded.
    """

    alpha: FloatArray
    beta: FloatArray
    F: FloatArray
    u: FloatArray
    Y: tuple[FloatArray, ...]
    factor: FloatArray
    inverse_factor: FloatArray
    inverse: FloatArray
    w: FloatArray
    mean: FloatArray
    s: FloatArray


@dataclass(frozen=True, eq=False)
class Direction:
    """A Newton step of all variables; names as in :class:`PrimalPoint` and :class:`DualPoint`."""

    x: FloatArray
    B: FloatArray
    C: FloatArray
    R: FloatArray
    slack: FloatArray
    alpha: FloatArray
    beta: FloatArray
    F: FloatArray
    u: FloatArray
    Y: tuple[FloatArray, ...]


def quaternion_moments(data: RelaxationData, R: FloatArray) -> tuple[FloatArray, ...]:
    """Return Y(R) of each rotation block."""
    return tuple(np.eye(4) / 4.0 + np.tensordot(R, slopes, 1) for _, slopes in data.lifted.quaternion_blocks)


def primal_point(
    data: RelaxationData, x: FloatArray, B: FloatArray, C: FloatArray, R: FloatArray, slack: FloatArray
) -> PrimalPoint | None:
    """Return the point, or None where it is not strictly inside the cones."""
    if (x <= 0.0)[data.valid].any() or (slack <= 0.0)[~data.equality].any():
        return None
    mean, G = _conditional_moments(data, x, B, C)
    Y = quaternion_moments(data, R)
    factor = _cholesky(G)
    if factor is None or any(_cholesky(block) is None for block in Y):
        return None
    inverse_factor: FloatArray = np.linalg.inv(factor).astype(np.float64, copy=False)
    return PrimalPoint(x, B, C, R, slack, mean, G, Y, inverse_factor)


def _conditional_moments(
    data: RelaxationData, x: FloatArray, B: FloatArray, C: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return B / x and C - sum B B^T / x."""
    mean = B / (x if data.is_full else np.where(data.valid, x, 1.0))[..., None]
    scatter = np.swapaxes(B, 1, 2) @ mean
    return mean, C - 0.5 * (scatter + np.swapaxes(scatter, 1, 2))


def dual_point(
    data: RelaxationData,
    alpha: FloatArray,
    beta: FloatArray,
    F: FloatArray,
    u: FloatArray,
    Y: tuple[FloatArray, ...],
) -> DualPoint | None:
    """Return the point, or None where it is not strictly inside the cones."""
    if (beta >= 0.0)[~data.equality].any() or any(_cholesky(block) is None for block in Y):
        return None
    factor = _cholesky(F)
    if factor is None:
        return None
    inverse_factor: FloatArray = np.linalg.inv(factor).astype(np.float64, copy=False)
    w = data.vectors - u[:, None, :]
    if not data.is_full:
        w[~data.valid] = 0.0
    whitened = w @ np.swapaxes(inverse_factor, 1, 2)
    s = data.cost - alpha[:, None] - beta[data.index] - (whitened * whitened).sum(axis=2)
    if not data.is_full:
        s = np.where(data.valid, s, 1.0)
    if (s <= 0.0).any():
        return None
    inverse = np.swapaxes(inverse_factor, 1, 2) @ inverse_factor
    return DualPoint(alpha, beta, F, u, Y, factor, inverse_factor, inverse, w, whitened @ inverse_factor, s)


def _cholesky(matrices: FloatArray) -> FloatArray | None:
    """Return the Cholesky factors, None where a matrix is not positive definite."""
    try:
        factor: FloatArray = np.linalg.cholesky(matrices).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        return None
    return factor if np.isfinite(factor).all() else None


def move_primal(data: RelaxationData, point: PrimalPoint, step: Direction, size: float) -> PrimalPoint | None:
    """Return the primal point a step further, None outside the cones."""
    return primal_point(
        data,
        point.x + size * step.x,
        point.B + size * step.B,
        point.C + size * step.C,
        point.R + size * step.R,
        point.slack + size * step.slack,
    )


def move_dual(data: RelaxationData, point: DualPoint, step: Direction, size: float) -> DualPoint | None:
    """Return the dual point a step further, None outside the cones."""
    return dual_point(
        data,
        point.alpha + size * step.alpha,
        point.beta + size * step.beta,
        point.F + size * step.F,
        point.u + size * step.u,
        tuple(y + size * dy for y, dy in zip(point.Y, step.Y, strict=True)),
    )


class PrimalRay:
    """How far a primal step can go: a concave margin, one at the point itself and zero on the cones' boundary."""

    def __init__(self, data: RelaxationData, point: PrimalPoint, step: Direction) -> None:
        self.data, self.point, self.step = data, point, step
        open_rows = ~data.equality
        x_rates = step.x[data.valid] / point.x[data.valid]
        self.slowest = min(x_rates.min(), _rate(step.slack[open_rows], point.slack[open_rows]))
        self.blocks = [
            (np.linalg.inv(np.linalg.cholesky(Y)), slope)
            for Y, slope in zip(point.Y, quaternion_slopes(data, step.R), strict=True)
        ]

    def margin(self, size: float) -> float:
        """Return the smallest share of the point's own distance to the boundary that is left after the step."""
        data, point, step = self.data, self.point, self.step
        linear = 1.0 + size * self.slowest
        if linear <= 0.0:
            return linear
        for inverse, slope in self.blocks:
            linear = min(linear, 1.0 + size * float(np.linalg.eigvalsh(inverse @ slope @ inverse.T)[0]))
        _, G = _conditional_moments(data, point.x + size * step.x, point.B + size * step.B, point.C + size * step.C)
        inverse = point.inverse_factor
        return min(linear, float(np.linalg.eigvalsh(inverse @ G @ np.swapaxes(inverse, 1, 2)).min()))


class DualRay:
    """How far a dual step can go; see :class:`PrimalRay`."""

    def __init__(self, data: RelaxationData, point: DualPoint, step: Direction) -> None:
        self.data, self.point = data, point
        open_rows = ~data.equality
        slowest = _rate(step.beta[open_rows], point.beta[open_rows])
        for Y, dY in zip(point.Y, step.Y, strict=True):
            inverse_factor = np.linalg.inv(np.linalg.cholesky(Y))
            slowest = min(slowest, float(np.linalg.eigvalsh(inverse_factor @ dY @ inverse_factor.T)[0]))
        inverse = point.inverse_factor
        self.rates, vectors = np.linalg.eigh(inverse @ step.F @ np.swapaxes(inverse, 1, 2))
        self.slowest = min(slowest, float(self.rates.min()))
        bend = -step.u[:, None, :] - point.mean @ step.F
        whitened = bend @ (np.swapaxes(inverse, 1, 2) @ vectors)
        self.squares = whitened * whitened
        self.change = slack_change(data, point, step)

    def margin(self, size: float) -> float:
        """Return the smallest share of the point's own distance to the boundary that is left after the step."""
        linear = 1.0 + size * self.slowest
        if linear <= 0.0:
            return linear
        curved = (self.squares @ (1.0 / (1.0 + size * self.rates))[..., None])[..., 0]
        left = 1.0 + (size * self.change - size * size * curved) / self.point.s
        return min(linear, float(left[self.data.valid].min()))


def quaternion_slopes(data: RelaxationData, direction: FloatArray) -> tuple[FloatArray, ...]:
    """Return the change of Y(R) of each rotation block along a change of R."""
    return tuple(np.tensordot(direction, slopes, 1) for _, slopes in data.lifted.quaternion_blocks)


def slack_change(data: RelaxationData, dual: DualPoint, step: Direction) -> FloatArray:
    """Return the linear change of every match's slack."""
    tilted = ((dual.mean @ step.F + 2.0 * step.u[:, None, :]) * dual.mean).sum(axis=2)
    return tilted - step.alpha[:, None] - step.beta[data.index]


def _rate(change: FloatArray, at: FloatArray) -> float:
    return float((change / at).min()) if len(at) else np.inf
