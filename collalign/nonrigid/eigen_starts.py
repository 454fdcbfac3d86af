"""Where a non-rigid match starts: signs of the lowest eigenfunctions.

Each start is a map of the source's samples into the target's samples, together with the Procrustes energy in the
lowest functions; refinement and judgement come later.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from collalign.nonrigid.map_tuning import TUNED
from collalign.nonrigid.spectral_shape import SpectralShape
from data_tools.arrays import BoolArray, FloatArray, IntArray
from pairwise.local.local_search import LocalMinima, MatchingCosts, minimise, procrustes
from pairwise.problem.problem import Problem


def embedded_problem(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    allowed: BoolArray,
    dim: int,
) -> Problem:
    """Return the Procrustes matching problem of samples in ``dim`` functions, where ``allowed`` (n, k)."""
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
    problem = embedded_problem(target, source, source_samples, allowed, TUNED.num_signs)
    signs = np.array(list(product((1.0, -1.0), repeat=TUNED.num_signs)))
    maps = np.unique(MatchingCosts(problem).assign(signs[:, :, None] * np.eye(TUNED.num_signs)), axis=0)
    return descend_maps(target, source, source_samples, allowed, maps, "signs")


def descend_maps(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    allowed: BoolArray,
    maps: IntArray,
    origin: str,
    *,
    sizes: tuple[int, ...] = TUNED.descent_sizes,
) -> LocalMinima:
    """Improve maps of the samples by local minimisation in more and more functions.

    Parameters
    ----------
    target, source : SpectralShape
    source_samples : ndarray of int, shape (k,)
        Rows of the source's working surface.
    allowed : ndarray of bool, shape (n, k)
        Which samples of the target each of these may go to.
    maps : ndarray of int, shape (m, k)
        Where to start.
    origin : str
        What the starts are called.
    sizes : tuple of int
        Numbers of functions, one round each.
    """
    for dim in sizes:
        problem = embedded_problem(target, source, source_samples, allowed, dim)
        minima = minimise(problem, procrustes(problem, maps), max_iterations=20, origins=origin)
        maps = minima.maps[: TUNED.num_kept]
    return minima


def candidate_mask(gaps: FloatArray, share: float) -> BoolArray:
    """Return which target samples each source sample may match, shape (n, k): the share nearest by descriptor.

    Maron et al. 2016, section 6.1. A mask that leaves no injective map is widened, by half its share at a time, until
    it has one.

    Parameters
    ----------
    gaps : ndarray, shape (n, k)
        How much the descriptors differ.
    share : float
    """
    ranks = gaps.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
    allowed = ranks < max(1, round(share * len(gaps)))
    while not _signs_have_injective_map(allowed):
        share = min(1.0, 1.5 * share)
        allowed |= ranks < round(share * len(gaps))
    return allowed


def wave_gaps(target: SpectralShape, source: SpectralShape, source_samples: IntArray) -> FloatArray:
    """Return how much the wave kernel signatures of samples differ, the mean of their logarithms, shape (n, k)."""
    differences = target.waves[target.samples][:, None, :] - source.waves[source_samples]
    return np.abs(differences).mean(axis=2)


def _signs_have_injective_map(allowed: BoolArray) -> bool:
    matched = maximum_bipartite_matching(csr_array(allowed), perm_type="row")
    return bool((matched >= 0).all())
