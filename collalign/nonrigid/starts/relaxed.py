"""PM-SDP in eigenfunctions: the paper's own start, and a source of several candidates for the portfolio."""

from __future__ import annotations

import numpy as np

from collalign.nonrigid.options import NonrigidOptions
from collalign.nonrigid.starts.eigenfunctions import descend_maps, embedded_problem
from collalign.nonrigid.surface.spectral import SpectralShape
from data_tools.arrays import BoolArray, IntArray
from pairwise.local.local_search import LocalMinima, MatchingCosts
from pairwise.pm_sdp.rounding import appendix_starts, draw_rotations, nearest_map
from pairwise.problem.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import RelaxationResult
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
    allowed: BoolArray,
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
    allowed : ndarray of bool, shape (n, k)
        Which samples may be matched.
    options : NonrigidOptions
    """
    is_fast = options.strategy == "fast"
    dim, bandwidth = (DIAGONAL_DIM, 0) if is_fast else (BANDED_DIM, options.bandwidth)
    problem = embedded_problem(target, source, source_samples, allowed, dim, bandwidth=bandwidth)
    relaxed = solve_pm_sdp(problem, tol=GAP_TOL, time_limit_s=options.time_limit_s)
    maps = rounded_maps(problem, relaxed, num_draws=NUM_DRAWS if options.is_portfolio else 0, seed=options.seed)
    sizes = (dim,) if options.is_portfolio else (dim, DIAGONAL_DIM)
    minima = descend_maps(target, source, source_samples, allowed, maps, "relaxation", sizes=sizes)
    return minima, relaxed.status


def rounded_maps(problem: Problem, relaxed: RelaxationResult, *, num_draws: int, seed: int) -> IntArray:
    """Return distinct maps of the samples that round a relaxation's solution, shape (m, k).

    The assignment nearest to X, what the four starts of appendix A of Maron et al. (2016) lead to, and draws.

    Parameters
    ----------
    problem : Problem
    relaxed : RelaxationResult
    num_draws, seed : int
    """
    draws = draw_rotations(problem, relaxed, num_draws, np.random.default_rng(seed))
    projected = problem.pattern.project(np.concatenate([appendix_starts(problem, relaxed), draws]))
    by_rotation = MatchingCosts(problem).assign(projected)
    return np.unique(np.vstack([nearest_map(problem, relaxed.X), by_rotation]), axis=0)
