"""Where the interior-point method starts: strictly feasible points near the central path, written down directly."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.moment_basis import MomentBasis
from pairwise.pm_sdp.variables import DualPoint, PrimalPoint, dual_point, primal_point


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
    counts = np.bincount(lifted.variable[lifted.variable > 0], minlength=s + 1)[1:].astype(np.float64)
    moments = lifted.interior_moments
    size = 2.0 * max(float(np.sqrt((spread**2).sum(axis=2)).max()), 1e-3) / np.sqrt(np.diag(moments).min())
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
        sums = data.row_sums(x[..., None] * data.vectors)[data.tied] / data.row_sums(x)[data.tied, None]
        means[data.tied] = sums - sums.mean(axis=0)
    return means
