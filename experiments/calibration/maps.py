"""How far a non-rigid map can be trusted, and which of two nearly equal ones is chosen, against the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from collalign.confidence import map_model
from collalign.nonrigid.map_options import NonrigidOptions
from collalign.nonrigid.portfolio import Refined, map_terms, point_terms
from collalign.nonrigid.spectral_shape import SpectralShape
from collalign.tools.match import nonrigid as match
from data_tools.arrays import BoolArray, FloatArray, IntArray
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.confidence.fit import fit_weights
from experiments.confidence.reliability import reliability
from experiments.maps.map_cells import (
    NUM_EVALUATED,
    QUICK_SURFACE,
    error_measure,
    evaluated_points,
    map_set,
    prepared,
)
from experiments.maps.map_sets import ANIMALS, BODIES, OTHER_CLASSES, SHREC07_CLASSES
from experiments.maps.paper_chain import in_files

#: Pairs of each set, drawn at random.
NUM_PAIRS, NUM_QUICK, SEED = 12, 2, 5


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoredPair:
    """The candidates of one pair of shapes, and what is known of each of them.

    Attributes
    ----------
    target : SpectralShape
    found : list of Refined
        The chosen one first, as it ends.
    terms : ndarray, shape (m, 3)
        As :func:`~collalign.nonrigid.portfolio.map_terms`.
    points : ndarray, shape (m, s, 2)
        As :func:`~collalign.nonrigid.portfolio.point_terms`, at the evaluated points.
    in_place : ndarray of bool, shape (m, s)
        Whether these are near their true places: of the first one by its map of all vertices, of others by that of
        the samples.
    """

    target: SpectralShape
    found: list[Refined]
    terms: FloatArray
    points: FloatArray
    in_place: BoolArray

    @property
    def right(self) -> BoolArray:
        """Whether each candidate is right."""
        return np.asarray(self.in_place.mean(axis=1) >= map_model.RIGHT_SHARE)

    def chosen(self) -> int:
        """Return the position of the chosen candidate."""
        return self.found.index(match.chosen_first(self.target, self.found, NonrigidOptions())[0])


def scored_pairs(data: Path, name: str, quick: bool) -> list[ScoredPair]:
    """Match some pairs of a set of maps and compare their candidates, at dense samples, with the truth."""
    maps = map_set(data, name)
    order = np.random.default_rng(SEED).permutation(len(maps.pairs))[
        : NUM_QUICK if quick else NUM_PAIRS
    ]
    scored = []
    for target, source in (maps.pairs[number] for number in order):
        settings: dict[str, Any] = {"set": name, "surface": QUICK_SURFACE if quick else {}}
        settings |= {"target": target, "source": source, "points": NUM_EVALUATED}
        to, of = prepared(data, settings, target), prepared(data, settings, source)
        found = match.finished(to.spectral, of.spectral, NonrigidOptions())

        def images(candidate: Refined) -> IntArray:
            forward = to.spectral.dense[candidate.functional_map.map_target_source]  # noqa: B023
            nearest = of.spectral.nearest_dense  # noqa: B023
            return in_files(forward[nearest], to.spectral, of.spectral)  # noqa: B023

        errors_of = error_measure(maps, settings, None)
        whole = match.vertex_maps(to.spectral, of.spectral, found[0])[0]
        errors = [errors_of(whole).direct, *(errors_of(images(one)).direct for one in found[1:])]
        at = of.spectral.nearest_dense[
            of.spectral.to_working[evaluated_points(maps, source, NUM_EVALUATED)]
        ]
        numbers = range(len(found))
        scored.append(
            ScoredPair(
                target=to.spectral,
                found=found,
                terms=np.stack([map_terms(to.spectral, found, number) for number in numbers]),
                points=np.stack(
                    [point_terms(to.spectral, of.spectral, found, number)[at] for number in numbers]
                ),
                in_place=np.stack(errors) <= map_model.NEAR,
            )
        )
    return scored


def measure_maps(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights to all candidates, judge them on the chosen ones; scan the margin of the choice."""
    drawn = {collection: scored_pairs(data, collection, quick) for collection in collections}
    pairs = [(number, pair) for number, some in enumerate(drawn.values()) for pair in some]
    terms, right = (
        np.concatenate([getattr(pair, one) for _, pair in pairs]) for one in ("terms", "right")
    )
    kind = np.concatenate([np.full(len(pair.found), number) for number, pair in pairs])
    chosen = np.concatenate([np.arange(len(pair.found)) == 0 for _, pair in pairs])
    found = _fitted("MAP", terms, right, kind, chosen)
    odds = terms @ map_model.MAP_WEIGHTS + map_model.MAP_CONSTANT
    sizes = np.concatenate([np.full(len(pair.found), pair.in_place.shape[1]) for _, pair in pairs])
    at_points = np.concatenate([pair.points.reshape(-1, 2) for _, pair in pairs])
    in_place = np.concatenate([pair.in_place.ravel() for _, pair in pairs])
    spread = [np.repeat(values, sizes) for values in (odds, kind, chosen)]
    found |= _fitted(
        "POINT", np.column_stack([at_points, spread[0]]), in_place, spread[1], spread[2]
    )

    def share(collection: str, changed: Mapping[str, Constant]) -> float:
        with patched(match, changed):
            return float(np.mean([pair.right[pair.chosen()] for pair in drawn[collection]]))

    return found | scan(constants_of(match, "ORIENTATION_WEIGHT"), collections, share, quick=quick)


def _fitted(
    name: str, terms: FloatArray, right: BoolArray, kind: FloatArray, chosen: BoolArray
) -> dict[str, Finding]:
    """Fit the weights of one of the two models."""
    weights, constant = _fit(terms, right, kind, chosen)
    code = getattr(map_model, f"{name}_WEIGHTS"), getattr(map_model, f"{name}_CONSTANT")
    stated = [
        1.0 / (1.0 + np.exp(-(terms @ some + one))) for some, one in (code, (weights, constant))
    ]
    kinds = np.unique(kind)
    if len(kinds) > 1:
        stated.append(np.empty(len(right)))
        for one in kinds:
            out = kind == one
            some, shift = _fit(terms[~out], right[~out], kind[~out], chosen[~out])
            stated[-1][out] = 1.0 / (1.0 + np.exp(-(terms[out] @ some + shift)))
    scores = [1.0 - reliability(one[chosen], right[chosen]).expected_error for one in stated]
    now, best, without = [*scores, float("nan")][:3]
    values: dict[str, Constant] = {
        f"{name}_WEIGHTS": tuple(weights.tolist()),
        f"{name}_CONSTANT": constant,
    }
    return {
        key: Finding(value=value, now=now, best=best, left_out=without)
        for key, value in values.items()
    }


def _fit(
    terms: FloatArray, right: BoolArray, kind: FloatArray, chosen: BoolArray
) -> tuple[FloatArray, float]:
    """Fit weights to all candidates, the constant to the chosen: more of them are right than of others like them."""
    weights, _ = fit_weights(terms, right, kind)
    odds = terms[chosen] @ weights
    _, which, counts = np.unique(kind[chosen], return_inverse=True, return_counts=True)

    def loss(constant: float) -> float:
        lost = np.logaddexp(0.0, odds + constant) - right[chosen] * (odds + constant)
        return float((lost / counts[which]).sum())

    return weights, float(minimize_scalar(loss).x)


CALIBRATION = Calibration(
    module=map_model.__name__,
    constants=constants_of(
        map_model, "MAP_WEIGHTS", "MAP_CONSTANT", "POINT_WEIGHTS", "POINT_CONSTANT"
    )
    | constants_of(match, "ORIENTATION_WEIGHT"),
    measure=measure_maps,
    collections=("scape", "tosca", *SHREC07_CLASSES, *OTHER_CLASSES, BODIES, ANIMALS),
    score="1 - expected calibration error of chosen maps; of ORIENTATION_WEIGHT the share of them that is right",
)
