"""Primal and dual iterates of the interior-point method, with the quantities that the Newton system needs.

The cone of one source point couples its matches' probabilities ``x``, the vectors ``B`` and the shared moments ``C``:
``C - sum_i B_i B_i^T / x_i`` is positive definite. Its dual couples ``F``, ``w = v - u - g`` and the slacks:
``s = cost - alpha - beta - w^T F^-1 w`` is positive. Both live here; a point outside its cone is ``None``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

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
    Y : ndarray, shape (q, 4, 4)
        Quaternion moments of each rotation block.
    """

    x: FloatArray
    B: FloatArray
    C: FloatArray
    R: FloatArray
    slack: FloatArray
    mean: FloatArray
    G: FloatArray
    Y: FloatArray


@dataclass(frozen=True, eq=False)
class DualPoint:
    """Multipliers inside their cones.

    Attributes
    ----------
    alpha, beta : ndarray, shapes (k,) and (n,)
        Potentials of the assignment; beta <= 0 where the row sum is an inequality.
    F, u : ndarray, shapes (k, s, s) and (k, s)
        Multipliers of each source point.
    g : ndarray, shape (n, s)
        Multipliers of the tied rows, zero in the others.
    Y : ndarray, shape (q, 4, 4)
        Multipliers of conv SO(3).
    factor, root, inverse : ndarray, shape (k, s, s)
        Lower Cholesky factor of F, its inverse, inverse of F.
    w : ndarray, shape (k, c, s)
        v - u - g.
    mean : ndarray, shape (k, c, s)
        F^-1 w.
    s : ndarray, shape (k, c)
        Slack of every match; one where padded.
    Y_inverse : ndarray, shape (q, 4, 4)
        Inverses of Y.
    """

    alpha: FloatArray
    beta: FloatArray
    F: FloatArray
    u: FloatArray
    g: FloatArray
    Y: FloatArray
    factor: FloatArray
    root: FloatArray
    inverse: FloatArray
    w: FloatArray
    mean: FloatArray
    s: FloatArray
    Y_inverse: FloatArray


@dataclass(frozen=True, eq=False)
class Direction:
    """A Newton step of all variables; names as in :class:`PrimalPoint` and :class:`DualPoint`.

    Attributes
    ----------
    bend : ndarray, shape (k, c, s)
        ``-du - dg - dF F^-1 w``: s changes by ``t ds - t^2 bend^T (F + t dF)^-1 bend`` along a share t of the step.
    ds : ndarray, shape (k, c)
        The linear change of s.
    """

    x: FloatArray
    B: FloatArray
    C: FloatArray
    R: FloatArray
    slack: FloatArray
    alpha: FloatArray
    beta: FloatArray
    F: FloatArray
    u: FloatArray
    g: FloatArray
    Y: FloatArray
    bend: FloatArray
    ds: FloatArray


def primal_point(
    data: RelaxationData,
    x: FloatArray,
    B: FloatArray,
    C: FloatArray,
    R: FloatArray,
    slack: FloatArray,
) -> PrimalPoint | None:
    """Return the point of x (k, c), B (k, c, s), C (s, s), R (s,) and slack (n,), None outside the cones."""
    if (x <= 0.0)[data.valid].any() or (slack <= 0.0)[~data.equality].any():
        return None
    Y = _QUARTER + data.lifted.quaternion_change(R)
    mean, G = conditional_moments(data, x, B, C)
    return (
        PrimalPoint(x, B, C, R, slack, mean, G, Y) if are_positive(G) and are_positive(Y) else None
    )


def conditional_moments(
    data: RelaxationData, x: FloatArray, B: FloatArray, C: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ``B / x`` (k, c, s), zero where padded, and ``C - sum_i B_i B_i^T / x_i`` (k, s, s)."""
    mean = B / np.where(data.valid, x, 1.0)[..., None]
    scatter = np.swapaxes(B, 1, 2) @ mean
    return mean, C - 0.5 * (scatter + np.swapaxes(scatter, 1, 2))


def inverse_factors(factors: NDArray[np.floating[Any]]) -> FloatArray:
    """Return the inverses of lower triangular matrices (q, a, a): LAPACK's, twice as fast as the general ones."""
    inverses = np.empty(factors.shape)
    for inverse, factor in zip(inverses, factors, strict=True):
        inverse[:] = scipy.linalg.lapack.dtrtri(factor.T)[0].T
    return inverses


def are_positive(blocks: FloatArray) -> bool:
    """Return whether all blocks (q, a, a) are positive definite."""
    try:
        np.linalg.cholesky(blocks)
    except np.linalg.LinAlgError:
        return False
    return True


def dual_point(
    data: RelaxationData,
    alpha: FloatArray,
    beta: FloatArray,
    F: FloatArray,
    u: FloatArray,
    g: FloatArray,
    Y: FloatArray,
) -> DualPoint | None:
    """Return the point of alpha (k,), beta (n,), F (k, s, s), u (k, s), g (n, s), Y (q, 4, 4), or None outside."""
    if (beta >= 0.0)[~data.equality].any() or not are_positive(Y):
        return None
    try:
        factor: FloatArray = np.linalg.cholesky(F).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        return None
    root = inverse_factors(factor)
    Y_inverse: FloatArray = np.linalg.inv(Y).astype(np.float64, copy=False)
    w = np.where(data.valid[..., None], data.vectors - u[:, None] - g[data.index], 0.0)
    whitened = w @ np.swapaxes(root, 1, 2)
    linear = data.cost - alpha[:, None] - beta[data.index]
    s = np.where(data.valid, linear - (whitened**2).sum(axis=2), 1.0)
    if not (s > 0.0).all():
        return None
    inverse = np.swapaxes(root, 1, 2) @ root
    return DualPoint(
        alpha, beta, F, u, g, Y, factor, root, inverse, w, whitened @ root, s, Y_inverse
    )


def move_primal(
    data: RelaxationData, point: PrimalPoint, step: Direction, size: float
) -> PrimalPoint | None:
    """Return the primal point a step further, None outside the cones."""
    return primal_point(
        data,
        point.x + size * step.x,
        point.B + size * step.B,
        point.C + size * step.C,
        point.R + size * step.R,
        point.slack + size * step.slack,
    )


def move_dual(
    data: RelaxationData, point: DualPoint, step: Direction, size: float
) -> DualPoint | None:
    """Return the dual point a step further, None outside the cones."""
    return dual_point(
        data,
        point.alpha + size * step.alpha,
        point.beta + size * step.beta,
        point.F + size * step.F,
        point.u + size * step.u,
        point.g + size * step.g,
        point.Y + size * step.Y,
    )
