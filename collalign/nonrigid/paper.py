"""The paper's own chain (section 6.1): PM-SDP, local minimisation in 30 functions, functional-map ICP."""

from __future__ import annotations

from collalign.nonrigid.options import NonrigidOptions
from collalign.nonrigid.portfolio import Refined, finish_by_zoomout, icp_map, judged
from collalign.nonrigid.starts.masks import candidate_mask
from collalign.nonrigid.starts.relaxed import relaxation_starts
from collalign.nonrigid.surface.spectral import SpectralShape
from pairwise.status import Status


def paper_candidates(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> tuple[list[Refined], Status]:
    """Return the maps of the paper's chain, lowest energy first, and how the relaxation ended.

    PM-SDP in 17 functions with a 5-diagonal R (strategy "paper") or in 30 with a diagonal R ("fast"), on 50 samples
    of the source and 100 of the target, each restricted to 30 % by average geodesic distance; local minimisation in
    30 functions; functional-map ICP on the dense samples. The first one is the paper's answer; there is no judgement.

    Parameters
    ----------
    target, source : SpectralShape
    options : NonrigidOptions
    """
    samples = source.samples[: options.num_source]
    allowed = candidate_mask(target, source, samples, options)
    minima, status = relaxation_starts(target, source, samples, allowed, options)
    maps = [icp_map(target, source, rotation) for rotation in minima.rotations[: options.num_candidates]]
    refined = [judged(target, source, refined, options.strategy) for refined in maps]
    return refined if options.ends_with_icp else finish_by_zoomout(target, source, refined), status
