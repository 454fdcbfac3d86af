"""PM-SDP in eigenfunctions: the paper's own start, and a source of several candidates for the portfolio."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from collalign.nonrigid.options import NonrigidOptions
from collalign.nonrigid.starts import descend_maps, embedded_problem
from collalign.nonrigid.surface import SpectralShape
from data_tools.arrays import BoolArray, FloatArray, IntArray
from pairwise.local_search import LocalMinima, MatchingCosts
from pairwise.problem import Problem
from pairwise.results import RelaxationResult
from pairwise.solve import solve_pm_sdp
from pairwise.status import Status

#: Functions of the relaxation with a banded R, and with a diagonal one in the fast strategy (Maron et al. 2016).
BANDED_DIM, DIAGONAL_DIM = 17, 30
#: Rotations drawn from the solution for the portfolio.
NUM_DRAWS = 31
#: Relative gap at which the relaxation stops: its rounding does not change any more.
GAP_TOL = 1e-3


def relaxation_starts(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    candidates: BoolArray,
    options: NonrigidOptions,
) -> tuple[LocalMinima, Status]:
    """Return the local minima that roundings of PM-SDP lead to, best energy first, and how its solver ended.

    In the portfolio they are minima in 17 functions like those of the other starts, from many draws. In the
    strategies of the paper they come from the four roundings of its appendix A, first in the relaxation's functions,
    then in 30.

    Parameters
    ----------
    target, source : SpectralShape
    source_samples : ndarray of int, shape (k,)
    candidates : ndarray of bool, shape (n, k)
    options : NonrigidOptions
    """
    is_fast = options.strategy == "fast"
    dim, bandwidth = (DIAGONAL_DIM, 0) if is_fast else (BANDED_DIM, options.bandwidth)
    problem = embedded_problem(target, source, source_samples, candidates, dim, bandwidth=bandwidth)
    relaxed = solve_pm_sdp(problem, tol=GAP_TOL, time_limit_s=options.time_limit_s)
    maps = rounded_maps(problem, relaxed, num_draws=NUM_DRAWS if options.is_portfolio else 0, seed=options.seed)
    sizes = (dim,) if options.is_portfolio else (dim, DIAGONAL_DIM)
    minima = descend_maps(target, source, source_samples, candidates, maps, "relaxation", sizes=sizes)
    return minima, relaxed.status


def rounded_maps(problem: Problem, relaxed: RelaxationResult, *, num_draws: int, seed: int) -> IntArray:
    """Return distinct maps of the samples that round a relaxation's solution, shape (m, k).

    The assignment nearest to X; the projection of R; the projections and assignments of the two factors of the best
    rank-one fit of the B_j, stacked (Maron et al. 2016, appendix A); and projections of draws from the Gaussian with
    mean [R] and second moment C.

    Parameters
    ----------
    problem : Problem
    relaxed : RelaxationResult
    num_draws, seed : int
    """
    pattern = problem.pattern
    stacked = np.moveaxis(relaxed.B, 1, 0).reshape(pattern.num_entries, -1)
    left, _, right = np.linalg.svd(stacked, full_matrices=False)
    sign = 1.0 if right[0].sum() >= 0 else -1.0
    factor = np.moveaxis((sign * right[0]).reshape(problem.num_source, problem.num_target), 0, 1)
    rotations = [pattern.unpack(pattern.pack(relaxed.R)), pattern.unpack(sign * left[:, 0])]
    mean = pattern.pack(relaxed.R)
    values, vectors = np.linalg.eigh(relaxed.C - np.outer(mean, mean))
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = mean + np.random.default_rng(seed).standard_normal((num_draws, len(values))) @ spread.T
    matrices = np.concatenate([np.stack(rotations), pattern.unpack(drawn)])
    projected = pattern.project(matrices)
    by_rotation = MatchingCosts(problem).assign(projected, np.ones(len(projected)))
    by_match = np.stack([_largest_assignment(weights, problem.candidates) for weights in (relaxed.X, factor)])
    return np.unique(np.concatenate([by_match, by_rotation]), axis=0)


def _largest_assignment(weights: FloatArray, candidates: BoolArray) -> IntArray:
    _, point_map = linear_sum_assignment(np.where(candidates, -weights, np.inf).T)
    return point_map
