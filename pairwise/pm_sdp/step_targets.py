"""Right hand sides of the Newton system: where a step should lead, with second-order terms of a former step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.variables import Direction, DualPoint, PrimalPoint


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
    quaternions : ndarray, shape (q, 4, 4)
        Of ``dY_primal + sym(Y_dual^-1 dY_dual Y_primal)``.
    ratio : ndarray, shape (k, c, s)
        Of ``F dB + dF B - x dw - w dx``.
    """

    moments: FloatArray
    products: FloatArray
    slacks: FloatArray
    quaternions: FloatArray
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
    gram = mu * dual.inverse - primal.G
    slacks = mu + primal.slack * dual.beta
    quaternions = mu * dual.Y_inverse - primal.Y
    if former is not None:
        ratio_terms, product_terms, gram_terms = _second_order_terms(data, primal, dual, former)
        ratio -= weight * ratio_terms
        products += weight * product_terms
        gram += weight * gram_terms
        slacks += weight * former.slack * former.beta
        turned = dual.Y_inverse @ former.Y @ data.lifted.quaternion_change(former.R)
        quaternions -= weight * _symmetric(turned)
    solved = ratio @ dual.inverse
    moments = np.empty((len(gram), *np.add(gram.shape[1:], 1)))
    moments[:, 0, 0] = primal.x.sum(axis=1) - 1.0
    moments[:, 0, 1:] = moments[:, 1:, 0] = (solved + primal.B).sum(axis=1) - primal.R
    moments[:, 1:, 1:] = gram + 2.0 * _symmetric(np.swapaxes(solved, 1, 2) @ primal.mean)
    return Targets(moments, products, slacks, quaternions, ratio)


def _second_order_terms(
    data: RelaxationData, primal: PrimalPoint, dual: DualPoint, step: Direction
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what a step leaves of ratio, products and Gram matrices."""
    x, dx = np.where(data.valid, primal.x, 1.0), step.x[..., None]
    curved = ((step.bend @ dual.inverse) * step.bend).sum(axis=2)
    bent = step.B - primal.mean * dx
    change = step.C - _symmetric(np.swapaxes(bent + step.B, 1, 2) @ primal.mean)
    gram = np.swapaxes(bent / x[..., None], 1, 2) @ bent - _symmetric(dual.inverse @ step.F @ change)
    return step.B @ step.F + dx * (step.u[:, None] + step.g[data.index]), x * curved - step.x * step.ds, gram


def _symmetric(matrices: FloatArray) -> FloatArray:
    return 0.5 * (matrices + np.swapaxes(matrices, 1, 2))
