"""Candidate maps of two surfaces, the chosen one first: as the surfaces are, and of regions if either is cut."""

from __future__ import annotations

from dataclasses import replace

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
from collalign.nonrigid.regions import (
    Region,
    is_cut,
    likely_regions,
    region_of,
    region_options,
)
from collalign.nonrigid.spectral_shape import SpectralShape
from data_tools.arrays import BoolArray

#: Regions whose map at few samples is worse than the best one's by more than this in score are not matched with all
#: samples, nor are more than so many.
REGION_LEAD, MOST_REGIONS = 1.0, 3
#: Nor is one whose map there is not better by this in score than that of the whole surface.
REGION_GAIN = 1.5


def ranked_maps(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> list[Refined]:
    """Return all candidates, the chosen one first, and that one mended and sharpened.

    If a surface is cut and the map is in doubt, the other one is cropped as well: the likeliest regions of it
    (:mod:`collalign.nonrigid.regions`) are matched, and their maps are candidates too.
    """
    screened = screened_from_within(target, source, options)
    found = _maps_of_whole(target, source, screened, options)
    cut = is_cut(target), is_cut(source)
    if not any(cut) or whole_trust(target, found, 0) >= SURE_FROM_WITHIN:
        return found
    most = screened[0].score - REGION_GAIN
    for is_target, other_is_cut in ((True, cut[1]), (False, cut[0])):
        if other_is_cut:
            found += _maps_of_regions(target, source, most, options, is_target=is_target)
    return chosen_first(target, distinct_maps(found), options)


def _maps_of_whole(
    target: SpectralShape, source: SpectralShape, screened: list[Refined], options: NonrigidOptions
) -> list[Refined]:
    """Return what :func:`ranked_maps` does of two surfaces as they are, by their maps from within at few samples."""
    found = find_candidates(target, source, screened, options)
    chosen, *others = chosen_first(target, found, options)
    return [sharpened(target, source, mended(target, source, chosen, options)), *others]


def _maps_of_regions(
    target: SpectralShape,
    source: SpectralShape,
    most: float,
    options: NonrigidOptions,
    *,
    is_target: bool,
) -> list[Refined]:
    """Return candidates of regions of one surface, of the target or of the source, as maps of all of it.

    Regions whose map at few samples has a score above ``most`` have none.
    """
    whole, cut = (target, source) if is_target else (source, target)

    def pair(region: Region) -> tuple[SpectralShape, SpectralShape]:
        return (region.surface, cut) if is_target else (cut, region.surface)

    looks = region_options(whole, is_screened=True)
    judged: list[tuple[float, BoolArray]] = []
    for kept in likely_regions(whole, cut):
        if small := region_of(whole, kept, looks):
            judged.append((screened_from_within(*pair(small), options)[0].score, kept))
    judged.sort(key=lambda one: one[0])
    found: list[Refined] = []
    for score, kept in judged[:MOST_REGIONS]:
        if score > min(most, judged[0][0] + REGION_LEAD):
            break
        region = region_of(whole, kept, region_options(whole, is_screened=False))
        if region is None:
            continue
        to, of = pair(region)
        found += [
            replace(
                one,
                functional_map=region.on_whole(one.functional_map, whole, cut, is_target=is_target),
            )
            for one in _maps_of_whole(to, of, screened_from_within(to, of, options), options)
        ]
    return found


def chosen_first(
    target: SpectralShape, found: list[Refined], options: NonrigidOptions
) -> list[Refined]:
    """Return candidates with the chosen one first, then by score."""
    ordered = sorted(found, key=lambda c: c.score)
    chosen = ordered[likeliest(target, ordered, options)]
    return [chosen, *(c for c in ordered if c is not chosen)]
