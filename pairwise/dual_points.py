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
    scatter : ndarray, shape (k, s, s)
        sum_i B_i B_i^T / x_i.
    G : ndarray, shape (k, s, s)
        C - scatter, positive definite.
    Y : tuple of ndarray (4, 4)
        Quaternion moments of each rotation block.
    """

    x: FloatArray
    B: FloatArray
    C: FloatArray
    R: FloatArray
    slack: FloatArray
    mean: FloatArray
    scatter: FloatArray
    G: FloatArray
    Y: tuple[FloatArray, ...]


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
    factor, inverse : ndarray, shape (k, s, s)
        Cholesky factor and inverse of F.
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
    mean = B / np.where(data.valid, x, 1.0)[..., None]
    scatter = np.swapaxes(B, 1, 2) @ mean
    G = C - 0.5 * (scatter + np.swapaxes(scatter, 1, 2))
    Y = quaternion_moments(data, R)
    if _cholesky(G) is None or any(_cholesky(block) is None for block in Y):
        return None
    return PrimalPoint(x, B, C, R, slack, mean, scatter, G, Y)


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
    inverse_factor = np.linalg.inv(factor)
    inverse = np.swapaxes(inverse_factor, 1, 2) @ inverse_factor
    w = np.where(data.valid[..., None], data.vectors - u[:, None, :], 0.0)
    whitened = w @ np.swapaxes(inverse_factor, 1, 2)
    s = data.cost - alpha[:, None] - beta[data.index] - np.einsum("jca,jca->jc", whitened, whitened)
    s = np.where(data.valid, s, 1.0)
    if (s <= 0.0).any():
        return None
    return DualPoint(alpha, beta, F, u, Y, factor, inverse, w, whitened @ inverse_factor, s)


def _cholesky(matrices: FloatArray) -> FloatArray | None:
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
