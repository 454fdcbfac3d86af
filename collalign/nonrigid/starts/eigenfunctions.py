"""Ways to start a non-rigid match: signs of the lowest eigenfunctions, roundings of PM-SDP, descriptors.

Each start is a map of the source's samples into the target's samples, together with the Procrustes energy in the
lowest functions; refinement and judgement come later.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import linear_sum_assignment

from collalign.nonrigid.starts.masks import wave_gaps
from collalign.nonrigid.surface.spectral_shape import SpectralShape
from data_tools.arrays import BoolArray, IntArray
from pairwise.local.local_search import LocalMinima, MatchingCosts, minimise, procrustes
from pairwise.problem.problem import Problem

#: Functions whose signs are enumerated: 2^8 combinations.
NUM_SIGNS = 8
#: Functions in which the maps that the signs give are improved, one after the other.
DESCENT_SIZES = (12, 17)
#: Maps that go from one descent to the next.
NUM_KEPT = 96


def embedded_problem(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    allowed: BoolArray,
    dim: int,
) -> Problem:
    """Return the Procrustes matching problem of the samples in the lowest ``dim`` eigenfunctions.

    Parameters
    ----------
    target, source : SpectralShape
    source_samples : ndarray of int, shape (k,)
    allowed : ndarray of bool, shape (n, k)
    dim : int
    """
    return Problem.from_user(
        target.functions[target.samples, :dim],
        source.functions[source_samples, :dim],
        group="O",
        allowed=allowed,
    )


def sign_starts(
    target: SpectralShape, source: SpectralShape, source_samples: IntArray, allowed: BoolArray
) -> LocalMinima:
    """Return local minima in 17 functions that the signs of the lowest 8 lead to, best energy first.

    Eigenfunctions of near-isometric shapes agree up to sign where their eigenvalues are simple; a full R in the
    larger spaces repairs those that are not.
    """
    problem = embedded_problem(target, source, source_samples, allowed, NUM_SIGNS)
    signs = np.array(list(product((1.0, -1.0), repeat=NUM_SIGNS)))
    maps = np.unique(MatchingCosts(problem).assign(signs[:, :, None] * np.eye(NUM_SIGNS)), axis=0)
    return descend_maps(target, source, source_samples, allowed, maps, "signs")


def descend_maps(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    allowed: BoolArray,
    maps: IntArray,
    origin: str,
    *,
    sizes: tuple[int, ...] = DESCENT_SIZES,
) -> LocalMinima:
    """Improve maps of the samples by local minimisation in more and more functions."""
    for dim in sizes:
        problem = embedded_problem(target, source, source_samples, allowed, dim)
        minima = minimise(problem, procrustes(problem, maps), max_iterations=20, origins=origin)
        maps = minima.maps[:NUM_KEPT]
    return minima


def descriptor_start(
    target: SpectralShape, source: SpectralShape, source_samples: IntArray, allowed: BoolArray
) -> LocalMinima:
    """Return the local minimum that the assignment of wave kernel signatures leads to."""
    gaps = wave_gaps(target, source, source_samples)
    _, point_map = linear_sum_assignment(np.where(allowed, gaps, np.inf).T)
    return descend_maps(target, source, source_samples, allowed, point_map[None], "descriptors")
