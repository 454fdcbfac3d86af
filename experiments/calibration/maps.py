"""How far a non-rigid map can be trusted, and which of two nearly equal ones is chosen, against landmarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.confidence import map_model
from collalign.nonrigid.map_options import NonrigidOptions
from collalign.nonrigid.portfolio import Refined, find_candidates, full_harmonic
from collalign.nonrigid.refine import between_files
from collalign.tools.match import nonrigid as match
from data_tools.arrays import IntArray
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.maps.map_cells import NUM_EVALUATED, evaluate, map_set, prepared
from experiments.maps.map_trials import QUICK_SURFACE

#: Pairs of each set, drawn at random.
NUM_PAIRS, NUM_QUICK, SEED = 12, 2, 5
#: A map of this mean error at the evaluated points, in units of sqrt(area), is right.
RIGHT = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedPair:
    """The candidates of one pair of shapes, and which of them are right."""

    found: list[Refined]
    right: list[bool]

    def chosen(self, options: NonrigidOptions) -> tuple[float, bool]:
        """Return the confidence of the chosen candidate, and whether it is right."""
        ordered = match.chosen_first(self.found, options)
        return match.confidence(ordered, options), self.right[self.found.index(ordered[0])]


def judged_pairs(data: Path, name: str, quick: bool) -> list[JudgedPair]:
    """Match some pairs of a set of maps and compare each of their candidates with the truth."""
    maps = map_set(data, name)
    order = np.random.default_rng(SEED).permutation(len(maps.pairs))[: NUM_QUICK if quick else NUM_PAIRS]
    options, judged = NonrigidOptions(), []
    for target, source in (maps.pairs[number] for number in order):
        settings: dict[str, Any] = {"set": name, "variant": "original", "surface": QUICK_SURFACE if quick else {}}
        settings |= {"target": target, "source": source, "points": NUM_EVALUATED}
        to, of = prepared(data, settings, target), prepared(data, settings, source)
        found = find_candidates(to.spectral, of.spectral, options)

        def images(candidate: Refined) -> IntArray:
            forward, _ = full_harmonic(to.spectral, of.spectral).of_all_vertices(candidate.functional_map)  # noqa: B023
            return between_files(forward, to.spectral.to_original, of.spectral.to_working)  # noqa: B023

        errors = [evaluate(maps, settings, images(one), (to.copy, of.copy), None).direct for one in found]
        judged.append(JudgedPair(found=found, right=[float(error.mean()) <= RIGHT for error in errors]))
    return judged


def measure_maps(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Choose and trust candidates with other values; see :data:`CALIBRATION` for their scores."""
    drawn = {collection: judged_pairs(data, collection, quick) for collection in collections}
    options = NonrigidOptions()

    def stated(collection: str, changed: Mapping[str, Constant]) -> float:
        with patched(map_model, changed):
            chosen = [pair.chosen(options) for pair in drawn[collection]]
        return 1.0 - float(np.mean([(confidence - right) ** 2 for confidence, right in chosen]))

    def share(collection: str, changed: Mapping[str, Constant]) -> float:
        with patched(match, changed):
            return float(np.mean([pair.chosen(options)[1] for pair in drawn[collection]]))

    constants = dict(CALIBRATION.constants)
    margin = {"ORIENTATION_MARGIN": constants.pop("ORIENTATION_MARGIN")}
    found = scan(constants, collections, stated, quick=quick)
    return found | scan(margin, collections, share, quick=quick)


CALIBRATION = Calibration(
    module=map_model.__name__,
    constants=constants_of(map_model, "SCORE_SCALE", "DOUBTFUL_SCORE", "DOUBT_SCALE")
    | constants_of(match, "ORIENTATION_MARGIN"),
    measure=measure_maps,
    collections=("scape", "ant"),
    score=f"1 - Brier score of the stated confidence; of ORIENTATION_MARGIN the share of maps of error below {RIGHT}",
)
