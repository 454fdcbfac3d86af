"""Right hand sides of the Newton system: where a step should lead, with second-order terms of a former step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.variables import Direction, DualPoint, PrimalPoint, quaternion_slopes, slack_change


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


def aim(
    data: RelaxationData,
    primal: PrimalPoint,
    dual: DualPoint,
    mu: float,
    former: Direction | None = None,
    weight: float = 1.0,
) -> Targets:
    """Return the right hand sides that lead to complementarity mu.

    Parameters
    ----------
    data, primal, dual
        The problem and the point.
    mu : float
        x s, F G, the rows' and the quaternions' products are to become mu (times I).
    former : Direction, optional
        A step whose second-order terms are made up for (Mehrotra 1992).
    weight : float
        Share of these terms: below one where the former step could not be taken in full.
    """
    ratio = primal.x[..., None] * dual.w - primal.B @ dual.F
    products = mu - primal.x * dual.s
    slacks = mu + primal.slack * dual.beta
    gram = mu * dual.inverse - primal.G
    inverses = [root.T @ root for root in dual.Y_roots]
    quaternions = tuple(mu * inverse - Y for inverse, Y in zip(inverses, primal.Y, strict=True))
    if former is not None:
        bend = -former.u[:, None, :] - dual.mean @ former.F
        curved = ((bend @ dual.inverse) * bend).sum(axis=2)
        ratio -= weight * (former.x[..., None] * former.u[:, None, :] + former.B @ former.F)
        products += weight * (primal.x * curved - former.x * slack_change(data, dual, former))
        slacks += weight * former.slack * former.beta
        gram += weight * _second_order_gram(data, primal, dual, former)
        quaternions = tuple(
            target - weight * _symmetrised(inverse @ dY @ slope)
            for target, inverse, dY, slope in zip(
                quaternions, inverses, former.Y, quaternion_slopes(data, former.R), strict=True
            )
        )
    return Targets(_moment_targets(primal, dual, ratio, gram), products, slacks, quaternions, ratio)


def _moment_targets(primal: PrimalPoint, dual: DualPoint, ratio: FloatArray, gram: FloatArray) -> FloatArray:
    """Return the moment equation's right hand side, what the sums of x and B still miss included."""
    solved = ratio @ dual.inverse
    num, size = dual.u.shape
    moments = np.empty((num, size + 1, size + 1))
    moments[:, 0, 0] = primal.x.sum(axis=1) - 1.0
    moments[:, 0, 1:] = solved.sum(axis=1) - (primal.R - primal.B.sum(axis=1))
    moments[:, 1:, 0] = moments[:, 0, 1:]
    cross = np.swapaxes(solved, 1, 2) @ primal.mean
    moments[:, 1:, 1:] = gram + cross + np.swapaxes(cross, 1, 2)
    return moments


def _second_order_gram(data: RelaxationData, primal: PrimalPoint, dual: DualPoint, step: Direction) -> FloatArray:
    """Return the second-order terms of ``F G = mu I`` with ``G = C - sum B B^T / x``."""
    weighted = primal.mean * step.x[..., None]
    bend = step.B - weighted
    linear = np.swapaxes(step.B, 1, 2) @ primal.mean
    change = step.C - linear - np.swapaxes(linear, 1, 2) + np.swapaxes(weighted, 1, 2) @ primal.mean
    x = primal.x if data.is_full else np.where(data.valid, primal.x, 1.0)
    curvature = np.swapaxes(bend / x[..., None], 1, 2) @ bend
    return curvature - _symmetrised(dual.inverse @ step.F @ change)


def _symmetrised(matrices: FloatArray) -> FloatArray:
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))
