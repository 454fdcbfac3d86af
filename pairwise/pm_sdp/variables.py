"""Primal and dual iterates of the interior-point method, with the quantities that the Newton system needs.

The cone of one source point couples its matches' probabilities ``x``, the vectors ``B`` and the shared moments ``C``:
``C - sum_i B_i B_i^T / x_i`` is positive definite. Its dual couples ``F``, ``w = v - u`` and the slacks:
``s = cost - alpha - beta - w^T F^-1 w`` is positive. Both live here; a point outside its cone is ``None``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData

#: Y at R = 0.
_QUARTER = np.eye(4) / 4.0


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
    Y_roots : tuple of ndarray (4, 4)
        The same of each Y.
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
    Y_roots: tuple[FloatArray, ...]


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
    Y_roots : tuple of ndarray (4, 4)
        Inverse of the Cholesky factor of each Y.
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
    Y_roots: tuple[FloatArray, ...]


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
    return tuple(_QUARTER + along(R, slopes) for _, slopes in data.lifted.quaternion_blocks)


def primal_point(
    data: RelaxationData, x: FloatArray, B: FloatArray, C: FloatArray, R: FloatArray, slack: FloatArray
) -> PrimalPoint | None:
    """Return the point, or None where it is not strictly inside the cones."""
    if (x <= 0.0)[data.valid].any() or (slack <= 0.0)[~data.equality].any():
        return None
    mean, G = conditional_moments(data, x, B, C)
    Y = quaternion_moments(data, R)
    factor = _cholesky(G)
    Y_roots = _inverse_roots(Y)
    if factor is None or Y_roots is None:
        return None
    inverse_factor: FloatArray = np.linalg.inv(factor).astype(np.float64, copy=False)
    return PrimalPoint(x, B, C, R, slack, mean, G, Y, inverse_factor, Y_roots)


def conditional_moments(
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
    Y_roots = _inverse_roots(Y)
    if (beta >= 0.0)[~data.equality].any() or Y_roots is None:
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
    mean = whitened @ inverse_factor
    return DualPoint(alpha, beta, F, u, Y, factor, inverse_factor, inverse, w, mean, s, Y_roots)


def _cholesky(matrices: FloatArray) -> FloatArray | None:
    """Return the Cholesky factors, None where a matrix is not positive definite."""
    try:
        factor: FloatArray = np.linalg.cholesky(matrices).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        return None
    return factor if np.isfinite(factor).all() else None


def _inverse_roots(blocks: tuple[FloatArray, ...]) -> tuple[FloatArray, ...] | None:
    """Return the inverses of the Cholesky factors, None where a block is not positive definite."""
    factors = [_cholesky(block) for block in blocks]
    if any(factor is None for factor in factors):
        return None
    return tuple(np.linalg.inv(factor).astype(np.float64, copy=False) for factor in factors if factor is not None)


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


def quaternion_slopes(data: RelaxationData, direction: FloatArray) -> tuple[FloatArray, ...]:
    """Return the change of Y(R) of each rotation block along a change of R."""
    return tuple(along(direction, slopes) for _, slopes in data.lifted.quaternion_blocks)


def along(direction: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return ``sum_a direction_a slopes_a`` for slopes (s, 4, 4)."""
    return (direction @ slopes.reshape(-1, 16)).reshape(4, 4)


def slack_change(data: RelaxationData, dual: DualPoint, step: Direction) -> FloatArray:
    """Return the linear change of every match's slack."""
    tilted = ((dual.mean @ step.F + 2.0 * step.u[:, None, :]) * dual.mean).sum(axis=2)
    return tilted - step.alpha[:, None] - step.beta[data.index]
