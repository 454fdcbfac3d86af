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
    from pairwise.pm_sdp.newton_kernels import first_order_terms, moment_targets, second_order_terms

    ratio, products, gram = first_order_terms(
        (primal.x, primal.B, primal.G), (dual.w, dual.s, dual.F, dual.inverse), mu
    )
    slacks = mu + primal.slack * dual.beta
    quaternions = mu * dual.Y_inverse - primal.Y
    if former is not None:
        x = primal.x if data.is_full else np.where(data.valid, primal.x, 1.0)
        step = (former.x, former.B, former.C, former.F, former.u, former.bend, former.ds)
        ratio_terms, product_terms, gram_terms = second_order_terms(x, primal.mean, dual.inverse, step)
        ratio -= weight * ratio_terms
        products += weight * product_terms
        gram += weight * gram_terms
        slacks += weight * former.slack * former.beta
        turned = dual.Y_inverse @ former.Y @ data.lifted.quaternion_change(former.R)
        quaternions -= weight * 0.5 * (turned + np.swapaxes(turned, 1, 2))
    moments = moment_targets(primal.x, primal.B, primal.mean, primal.R, dual.inverse, ratio, gram)
    return Targets(moments, products, slacks, quaternions, ratio)
