"""From a relaxation's solution to rotations worth starting from: the paper's four starts, and draws.

X_ij is read as the probability that source point j goes to target point i, R as E[R] and C as E[[R][R]^T]. Where a
pair has several good poses these are mixtures, and one rounding of R may be none of them: draws from (R, C) keep them
apart. All starts are returned as matrices whose projection
(:meth:`pairwise.rotation_pattern.RotationPattern.project`) is meant.
"""

from __future__ import annotations

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from pairwise.problem import Problem
from pairwise.results import RelaxationResult

#: Probabilities below this are rounding errors of the solver.
_NEGLIGIBLE = 1e-6


def appendix_starts(problem: Problem, relaxation: RelaxationResult) -> FloatArray:
    """Return the four starts of Maron et al. 2016, appendix A, as matrices to project, shape (4, d, d).

    They are R, the map nearest to X, and the two factors of the best rank-one fit of the stacked B_j: at a single
    pose ``B_j = [R] X_j^T``. A map stands for its Procrustes moment.

    Parameters
    ----------
    problem : Problem
    relaxation : RelaxationResult
        Its solution.
    """
    entries, probabilities = rank_one_factors(relaxation)
    maps = [nearest_map(problem, relaxation.X), nearest_map(problem, probabilities)]
    weighted = problem.weights[:, None] * problem.source
    moments = [problem.target[point_map].T @ weighted for point_map in maps]
    return np.stack([relaxation.R, problem.pattern.unpack(entries), *moments])


def rank_one_factors(relaxation: RelaxationResult) -> tuple[FloatArray, FloatArray]:
    """Return the factors [R] (r,) and X (n, k) of the best rank-one fit of the stacked B_j.

    The fit leaves the common sign of the factors open, and with the wrong one both starts are useless: X is not
    negative, so its factor is given a positive sum.
    """
    k, r, n = relaxation.B.shape
    stacked = relaxation.B.transpose(1, 0, 2).reshape(r, k * n)
    left, values, right = np.linalg.svd(stacked, full_matrices=False)
    sign = 1.0 if right[0].sum() >= 0 else -1.0
    return sign * values[0] * left[:, 0], sign * right[0].reshape(k, n).T


def nearest_map(problem: Problem, probabilities: FloatArray) -> IntArray:
    """Return the allowed map of largest total probability (n, k), shape (k,), by exact assignment."""
    scores = np.where(problem.allowed, probabilities, -np.inf)
    return np.asarray(scipy.optimize.linear_sum_assignment(scores.T, maximize=True)[1])


def draw_rotations(
    problem: Problem, relaxation: RelaxationResult, num_draws: int, rng: np.random.Generator
) -> FloatArray:
    """Draw from the relaxation's solution: matrices to project, shape (num_draws, d, d).

    Half of them are Gaussian with mean [R] and covariance C - [R][R]^T; the others are means under one match,
    ``E[R | j -> i] = B_ij / X_ij``, drawn with probability X_ij: matches tell the poses apart.
    """
    mean = problem.pattern.pack(relaxation.R)
    values, vectors = np.linalg.eigh(relaxation.C - np.outer(mean, mean))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    gaussian = mean + rng.standard_normal((num_draws - num_draws // 2, len(mean))) @ root.T
    conditional = _conditional_means(relaxation, num_draws // 2, rng)
    return problem.pattern.unpack(np.concatenate([gaussian, conditional]))


def _conditional_means(
    relaxation: RelaxationResult, num: int, rng: np.random.Generator
) -> FloatArray:
    """Return E[[R] | j -> i] of matches drawn with probability X_ij, shape (num, r)."""
    mass = np.where(relaxation.X > _NEGLIGIBLE, relaxation.X, 0.0).T
    drawn = rng.choice(mass.size, size=num, p=mass.ravel() / mass.sum())
    source, target = np.unravel_index(drawn, mass.shape)
    return relaxation.B[source, :, target] / mass[source, target, None]
