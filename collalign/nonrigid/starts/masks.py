"""Which samples may be matched at all: those with similar descriptors."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from collalign.nonrigid.options import NonrigidOptions
from collalign.nonrigid.surface.spectral import SpectralShape
from data_tools.arrays import BoolArray, FloatArray, IntArray

#: Share of the target's samples that each source sample may match, by descriptor (agd: the paper's).
DEFAULT_SHARES = {"agd": 0.3, "wks": 0.15}


def candidate_mask(
    target: SpectralShape, source: SpectralShape, source_samples: IntArray, options: NonrigidOptions
) -> BoolArray:
    """Return which target samples each source sample may match, shape (n, k).

    The nearest ones by descriptor: a share of them (Maron et al. 2016, section 6.1: 30 % by average geodesic
    distance), or those within a threshold. A mask that leaves no injective map is widened, by half its share at a
    time, until it has one.

    Parameters
    ----------
    target, source : SpectralShape
    source_samples : ndarray of int, shape (k,)
        Working vertices of the source.
    options : NonrigidOptions
    """
    kind = options.mask or ("wks" if options.is_portfolio else "agd")
    if kind == "none":
        return np.ones((len(target.samples), len(source_samples)), dtype=bool)
    gaps = descriptor_gaps(kind, target, source, source_samples)
    share = options.mask_share or DEFAULT_SHARES[kind]
    ranks = gaps.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
    allowed = ranks < max(1, round(share * len(gaps)))
    if options.mask_threshold is not None:
        allowed = gaps <= options.mask_threshold
    while not _has_injective_map(allowed):
        share = min(1.0, 1.5 * share)
        allowed |= ranks < round(share * len(gaps))
    return allowed


def descriptor_gaps(kind: str, target: SpectralShape, source: SpectralShape, source_samples: IntArray) -> FloatArray:
    """Return how much the descriptors of samples differ, shape (n, k).

    ``agd``: absolute difference, in units of sqrt(area); ``wks``: mean absolute difference of the logarithms.
    """
    if kind == "agd":
        return np.abs(target.agd[target.samples][:, None] - source.agd[source_samples])
    differences = target.waves[target.samples][:, None, :] - source.waves[source_samples]
    return np.abs(differences).mean(axis=2)


def _has_injective_map(allowed: BoolArray) -> bool:
    matched = maximum_bipartite_matching(csr_array(allowed), perm_type="row")
    return bool((matched >= 0).all())
