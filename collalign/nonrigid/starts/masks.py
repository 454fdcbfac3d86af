"""Which samples may be matched at all: those with similar descriptors."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from collalign.nonrigid.surface.spectral_shape import SpectralShape
from data_tools.arrays import BoolArray, FloatArray, IntArray

#: Share of the target's samples that each source sample may match, by the wave kernel signature.
WAVE_SHARE = 0.15


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
    while not _has_injective_map(allowed):
        share = min(1.0, 1.5 * share)
        allowed |= ranks < round(share * len(gaps))
    return allowed


def wave_gaps(target: SpectralShape, source: SpectralShape, source_samples: IntArray) -> FloatArray:
    """Return how much the wave kernel signatures of samples differ, the mean of their logarithms, shape (n, k)."""
    differences = target.waves[target.samples][:, None, :] - source.waves[source_samples]
    return np.abs(differences).mean(axis=2)


def _has_injective_map(allowed: BoolArray) -> bool:
    matched = maximum_bipartite_matching(csr_array(allowed), perm_type="row")
    return bool((matched >= 0).all())
