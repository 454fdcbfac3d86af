"""Candidate maps of two surfaces, the chosen one first: as the surfaces are, and of regions if one of them is cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.nonrigid.map_options import NonrigidOptions
from collalign.nonrigid.portfolio import (
    SURE_FROM_WITHIN,
    Refined,
    distinct_maps,
    find_candidates,
    likeliest,
    mended,
    screened_from_within,
    sharpened,
    whole_trust,
)
from collalign.nonrigid.regions import is_cut, likely_regions
from collalign.nonrigid.spectral_shape import SpectralShape

#: Regions whose map at few samples is worse than the best one's by more than this in score are not matched with all
#: samples, nor are more than so many.
REGION_LEAD, MOST_REGIONS = 1.0, 3
#: Nor is one whose map there is not better by this in score than that of the whole surface.
REGION_GAIN = 2.5


def ranked_maps(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> list[Refined]:
    """Return all candidates, the chosen one first, and that one mended and sharpened.

    If one surface alone is cut and the map is in doubt, the other one is cropped as well: the likeliest regions of it
    (:mod:`collalign.nonrigid.regions`) are matched, and their maps are candidates too.
    """
    found = _maps_of_whole(target, source, options)
    if is_cut(target) == is_cut(source) or whole_trust(target, found, 0) >= SURE_FROM_WITHIN:
        return found
    found = distinct_maps([*found, *_maps_of_regions(target, source, options)])
    return chosen_first(target, found, options)


def _maps_of_whole(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> list[Refined]:
    """Return what :func:`ranked_maps` does of two surfaces as they are."""
    chosen, *others = chosen_first(target, find_candidates(target, source, options), options)
    return [sharpened(target, source, mended(target, source, chosen, options)), *others]


def _maps_of_regions(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> list[Refined]:
    """Return candidates of regions of the surface that is not cut, as maps of all of it."""
    is_target = is_cut(source)
    whole, cut = (target, source) if is_target else (source, target)
    regions = likely_regions(whole, cut)
    if not regions:
        return []
    pairs: list[tuple[SpectralShape, SpectralShape]] = [
        (one.surface, cut) if is_target else (cut, one.surface) for one in regions
    ]
    of_whole, *scores = (
        screened_from_within(*pair, options)[0].score for pair in ((target, source), *pairs)
    )
    most = min([of_whole - REGION_GAIN, *(score + REGION_LEAD for score in scores)])
    found: list[Refined] = []
    for number in np.argsort(scores, kind="stable")[:MOST_REGIONS].tolist():
        if scores[number] > most:
            break
        to, of = pairs[int(number)]
        found += [
            replace(
                one,
                functional_map=regions[number].on_whole(
                    one.functional_map, whole, cut, is_target=is_target
                ),
            )
            for one in _maps_of_whole(to, of, options)
        ]
    return found


def chosen_first(
    target: SpectralShape, found: list[Refined], options: NonrigidOptions
) -> list[Refined]:
    """Return candidates with the chosen one first, then by score."""
    ordered = sorted(found, key=lambda c: c.score)
    chosen = ordered[likeliest(target, ordered, options)]
    return [chosen, *(c for c in ordered if c is not chosen)]
