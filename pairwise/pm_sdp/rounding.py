"""From a relaxation's solution to rotations worth starting from: the paper's four starts, and two kinds of draws.

X_ij is read as the probability that source point j goes to target point i, R as E[R] and C as E[[R][R]^T]. Where a
pair has several good poses these are mixtures, and one rounding of R may be none of them: draws from (R, C), and
extreme points of the nearly optimal set (Maron et al. 2016, theorem 3), keep them apart. All starts are returned as
matrices whose projection (:meth:`pairwise.problem.pattern.RotationPattern.project`) is meant.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import FloatArray, IntArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.interior_point import solve_dual
from pairwise.problem.problem import Problem
from pairwise.relaxations import full_variables
from pairwise.results import RelaxationResult

#: Probabilities below this are rounding errors of the solver.
_NEGLIGIBLE = 1e-6
#: An extreme-point draw: size of its linear energy beside the relaxation's value, and the gap it is solved to.
_TILT, _TILTED_TOL = 0.2, 1e-2


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
    moments = [_moment(problem, point_map) for point_map in maps]
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
    """Return the allowed map of largest total probability, shape (k,), by exact assignment.

    Parameters
    ----------
    problem : Problem
    probabilities : ndarray, shape (n, k), or (n + 1, k) in partial matching
        The last row is then that of staying unmatched.
    """
    n = problem.num_target
    scores = np.where(problem.allowed, probabilities[:n], -np.inf)
    unmatched = np.repeat(probabilities[n:], problem.max_unmatched, axis=0)
    point_map = linear_sum_assignment(np.concatenate([scores, unmatched]).T, maximize=True)[1]
    return np.where(point_map < n, point_map, -1)


def draw_rotations(
    problem: Problem, relaxation: RelaxationResult, num_draws: int, rng: np.random.Generator
) -> FloatArray:
    """Draw from the relaxation's solution: matrices to project, shape (num_draws, d, d).

    Half of them are Gaussian with mean [R] and covariance C - [R][R]^T; the others are means under one match,
    ``E[R | j -> i] = B_ij / X_ij``, drawn with probability X_ij: matches tell the poses apart.

    Parameters
    ----------
    problem : Problem
    relaxation : RelaxationResult
    num_draws : int
    rng : Generator
    """
    mean = problem.pattern.pack(relaxation.R)
    values, vectors = np.linalg.eigh(relaxation.C - np.outer(mean, mean))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    gaussian = mean + rng.standard_normal((num_draws - num_draws // 2, len(mean))) @ root.T
    conditional = _conditional_means(relaxation, problem.num_target, num_draws // 2, rng)
    return problem.pattern.unpack(np.concatenate([gaussian, conditional]))


def extreme_starts(
    problem: Problem, relaxation: RelaxationResult, num_draws: int, rng: np.random.Generator
) -> FloatArray:
    """Return the appendix's starts at extreme points of the nearly optimal set, shape (4 num_draws, d, d).

    Where the value of the relaxation is that of several poses at once, its solution is a mixture of them. A random
    linear energy of R beside the relaxed energy leaves one: without noise almost surely (Maron et al. 2016,
    theorem 3), with noise one of low energy. Every draw solves the relaxation once more, to a wide gap.

    :func:`pairwise.match` uses them only if asked (``num_extreme_draws``), for on shapes they add little. At 30
    points, four of them found the best energy of all ways for 75 % of 20 pairs at d = 7, 60 % and 35 % with diagonal
    R at d = 10 and 17, 60 % with tridiagonal R at d = 10 (10 % by themselves alone) and none of 6 pairs at d = 17. 64
    draws from (R, C), at a quarter of the time, found it for 95, 95, 80, 65 and 83 %; search, at less than half the
    time of these, for 100, 100, 90, 75 and 50 % (``python -m tests.benchmarks.bench_draws draws``).

    Parameters
    ----------
    problem : Problem
        Without unmatched points, and with some freedom of R.
    relaxation : RelaxationResult
        The solution without the linear energy, which sets its size.
    num_draws : int
    rng : Generator
    """
    data = RelaxationData.from_problem(problem)
    starts = [np.zeros((0, problem.dim, problem.dim))]
    size = _TILT * max(relaxation.value, 1e-3 * data.constant)
    for _ in range(num_draws):
        direction = rng.standard_normal(data.lifted.num_variables)
        direction *= size / np.linalg.norm(direction)
        tilted = data.with_linear_energy(direction)
        x, b, rotation, moments = full_variables(data, solve_dual(tilted, tol=_TILTED_TOL))
        starts.append(appendix_starts(problem, replace(relaxation, R=rotation, X=x, C=moments, B=b)))
    return np.concatenate(starts)


def _conditional_means(relaxation: RelaxationResult, n: int, num: int, rng: np.random.Generator) -> FloatArray:
    """Return E[[R] | j -> i] of matches drawn with probability X_ij, shape (num, r)."""
    mass = np.where(relaxation.X[:n] > _NEGLIGIBLE, relaxation.X[:n], 0.0).T
    drawn = rng.choice(mass.size, size=num, p=mass.ravel() / mass.sum())
    source, target = np.unravel_index(drawn, mass.shape)
    return relaxation.B[source, :, target] / mass[source, target, None]


def _moment(problem: Problem, point_map: IntArray) -> FloatArray:
    weights = np.where(point_map >= 0, problem.weights, 0.0)
    return problem.target[point_map].T @ (weights[:, None] * problem.source)
