"""Steps of the interior-point method: where it starts, where a step should lead, and how far it may go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.moment_basis import MomentBasis
from pairwise.pm_sdp.variables import (
    Direction,
    DualPoint,
    PrimalPoint,
    are_positive,
    dual_point,
    inverse_factors,
    primal_point,
)


def starting_points(data: RelaxationData, basis: MomentBasis) -> tuple[PrimalPoint, DualPoint]:
    """Return strictly feasible points near the central path: uniform X, F a large multiple of the identity."""
    lifted = data.lifted
    k, s = len(data.index), lifted.num_variables
    x = data.valid / data.valid.sum(axis=1, keepdims=True)
    g = _row_means(data, x)
    vectors = np.where(data.valid[..., None], data.vectors - g[data.index], 0.0)
    means = np.einsum("jc,jca->ja", x, vectors)
    u = means - means.mean(axis=0)
    spread = np.where(data.valid[..., None], vectors - u[:, None, :], 0.0)
    counts = np.bincount(lifted.variable[lifted.variable > 0], minlength=s + 1)[1:].astype(
        np.float64
    )
    moments = lifted.interior_moments
    size = (
        2.0
        * max(float(np.sqrt((spread**2).sum(axis=2)).max()), 1e-3)
        / np.sqrt(np.diag(moments).min())
    )
    slack = np.where(data.equality, 0.0, np.maximum(1.0 - data.row_sums(x), 0.5))
    while True:
        F = np.tile(size * np.diag(counts), (k, 1, 1))
        mu = size * float((counts * np.diag(moments)).mean())
        R = means.mean(axis=0) / (size * counts)
        M = np.zeros((s + 1, s + 1))
        M[0, 0], M[0, 1:], M[1:, 0], M[1:, 1:] = 1.0, R, R, moments
        M = M + basis.unpack(basis.correction(-np.einsum("mab,ab->m", lifted.equations, M)))
        B = x[..., None] * spread / (size * counts)
        primal = primal_point(data, x, B, M[1:, 1:], M[0, 1:], slack)
        beta = -np.divide(mu, slack, out=np.zeros_like(slack), where=~data.equality)
        quad = (spread**2 / (size * counts)).sum(axis=2)
        alpha = np.where(data.valid, data.cost - beta[data.index] - quad, np.inf).min(axis=1)
        alpha = alpha - mu * data.valid.sum(axis=1)
        Y = np.tile(4.0 * mu * np.eye(4), (len(lifted.quaternion_blocks), 1, 1))
        dual = dual_point(data, alpha, beta, F, u, g, Y)
        if primal is not None and dual is not None:
            return primal, dual
        size *= 2.0


def _row_means(data: RelaxationData, x: FloatArray) -> FloatArray:
    """Return the mean vector of each tied row under x, less the mean of all of them, shape (n, s)."""
    means = np.zeros((data.num_rows, data.lifted.num_variables))
    if data.tied.any():
        sums = (
            data.row_sums(x[..., None] * data.vectors)[data.tied]
            / data.row_sums(x)[data.tied, None]
        )
        means[data.tied] = sums - sums.mean(axis=0)
    return means


#: A step shorter than this is no progress.
SHORTEST_STEP = 1e-4
#: Bisection ends when the interval is this share of its upper end.
_PRECISION = 1.0 / 64.0


def longest_primal(
    data: RelaxationData, point: PrimalPoint, step: Direction, least: float
) -> float:
    """Return a size of at most one after which x, slack, G and Y keep at least the share ``least`` of themselves.

    Parameters
    ----------
    data, point, step
        The problem, the point and where it should go.
    least : float
        In [0, 1).
    """
    x, bent, change = _along(data, point, step)
    transposed, least_G = np.swapaxes(bent, 1, 2), (1.0 - least) * point.G
    rates = (
        (step.x / x).min(),
        (step.slack / np.where(data.equality, 1.0, point.slack)).min(),
        _lowest_rate(point.Y, data.lifted.quaternion_change(step.R)),
    )

    def keeps(trial: float) -> bool:
        curved = transposed @ (bent * (trial**2 / (x + trial * step.x))[..., None])
        return are_positive(least_G + trial * change - curved)

    return _longest(keeps, rates, least)


def longest_dual(data: RelaxationData, point: DualPoint, step: Direction, least: float) -> float:
    """Return a size of at most one after which beta, F, s and Y keep at least the share ``least`` of themselves.

    Parameters
    ----------
    data, point, step, least
        See :func:`longest_primal`.
    """
    # (F + t dF)^-1 = root^T V diag(1 / (1 + t rates)) V^T root, V the eigenvectors
    root = point.root
    rates, eigenvectors = np.linalg.eigh(root @ step.F @ np.swapaxes(root, 1, 2))
    bends = (step.bend @ (np.swapaxes(root, 1, 2) @ eigenvectors)) ** 2
    least_s, free = (1.0 - least) * point.s, ~data.equality
    lowest = (
        rates.min(),
        (step.beta[free] / point.beta[free]).min(initial=0.0),
        _lowest_rate(point.Y, step.Y),
    )

    def keeps(trial: float) -> bool:
        change = step.ds - trial * (bends @ (1.0 / (1.0 + trial * rates))[..., None])[..., 0]
        return bool((least_s + trial * change >= 0.0)[data.valid].all())

    return _longest(keeps, lowest, least)


def _longest(
    keeps: Callable[[float], bool], rates: tuple[float, float, float], least: float
) -> float:
    """Return the longest size up to one at which a cone is kept, by bisection, and ``1 + size rate`` is ``least``."""
    low = 0.0
    high = trial = (1.0 - least) / max(1.0 - least, -min(rates))
    while True:
        low, high = (trial, high) if keeps(trial) else (low, trial)
        if high - low <= _PRECISION * high:
            return low
        trial = 0.5 * (low + high)


def _lowest_rate(blocks: FloatArray, changes: FloatArray) -> float:
    """Return the smallest eigenvalue of the changes (q, a, a) relative to positive definite blocks; zero of none."""
    root = inverse_factors(np.linalg.cholesky(blocks))
    rates = np.linalg.eigvalsh(root @ changes @ np.swapaxes(root, 1, 2))
    return float(rates.min(initial=0.0))


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
        rotated = dual.Y_inverse @ former.Y @ data.lifted.quaternion_change(former.R)
        quaternions -= weight * _symmetric(rotated)
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
    x, bent, change = _along(data, primal, step)
    curved = ((step.bend @ dual.inverse) * step.bend).sum(axis=2)
    gram = np.swapaxes(bent / x[..., None], 1, 2) @ bent - _symmetric(
        dual.inverse @ step.F @ change
    )
    return (
        step.B @ step.F + step.x[..., None] * (step.u[:, None] + step.g[data.index]),
        x * curved - step.x * step.ds,
        gram,
    )


def _along(
    data: RelaxationData, point: PrimalPoint, step: Direction
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x (k, c), bent (k, c, s) and change (k, s, s), which say how G changes along a step.

    After a share t of it, it is ``G + t change - t^2 sum_i bent_i bent_i^T / (x_i + t dx_i)``; x is one where padded.
    """
    bent = step.B - point.mean * step.x[..., None]
    change = step.C - _symmetric(np.swapaxes(bent + step.B, 1, 2) @ point.mean)
    return np.where(data.valid, point.x, 1.0), bent, change


def _symmetric(matrices: FloatArray) -> FloatArray:
    return 0.5 * (matrices + np.swapaxes(matrices, 1, 2))
