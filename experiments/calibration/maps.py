"""How far a non-rigid map can be trusted, and which of two nearly equal ones is chosen, against the truth.

The pairs are cells of ``python -m experiments bodies`` and ``cuts``, kept in the same store. What is
measured of a pair does not depend on the weights.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from collalign.confidence import map_model
from collalign.engine.records import Record
from collalign.engine.store import Store
from collalign.nonrigid import portfolio
from data_tools.arrays import BoolArray, FloatArray
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.confidence.fit import fit_weights
from experiments.confidence.reliability import reliability
from experiments.experiment import STORE, Bench
from experiments.maps.bodies import EVIDENCE, measured_pairs, terms_of
from experiments.maps.cuts import measured_cuts
from experiments.maps.map_sets import ANIMALS, BIPEDS, BIPEDS_APART, BODIES

#: Pairs of each set, drawn at random.
PAIRS = {BIPEDS: 20, BIPEDS_APART: 6, BODIES: 20, ANIMALS: 4, "human": 3, "armadillo": 4, "ant": 4}
NUM_QUICK = 2
#: The pairs of ``python -m experiments cuts``.
CUT_BIPEDS = "cut bipeds"


def judged_pairs(data: Path, collections: Sequence[str], *, quick: bool) -> dict[str, list[Record]]:
    """Match pairs of sets of maps and compare all candidates with the truth; the store keeps them.

    Returns
    -------
    dict of str to list of dict
        As :func:`experiments.maps.bodies.measure_body_map`.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / STORE.name if quick else STORE
        path.parent.mkdir(parents=True, exist_ok=True)
        with Store.open(path) as store:
            bench = Bench(data=data, store=store, quick=quick)
            return {
                name: [*measured_cuts(bench, NUM_QUICK if quick else None).values()]
                if name == CUT_BIPEDS
                else measured_pairs(bench, name, NUM_QUICK if quick else PAIRS[name])
                for name in collections
            }


def right_candidates(pair: Record) -> BoolArray:
    """Return which candidates of a pair are right, shape (m,)."""
    errors = np.concatenate([[pair["error"]], pair["candidates"][1:]])
    return np.asarray(errors < map_model.NEAR)


def measure_maps(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights to all candidates, judge them on the chosen ones; scan the margin of the choice."""
    drawn = judged_pairs(data, collections, quick=quick)
    pairs = [(number, pair) for number, some in enumerate(drawn.values()) for pair in some]
    terms = np.concatenate([terms_of(pair) for _, pair in pairs])
    right = np.concatenate([right_candidates(pair) for _, pair in pairs])
    kind = np.concatenate([np.full(len(pair["scores"]), number) for number, pair in pairs])
    chosen = np.concatenate([np.arange(len(pair["scores"])) == 0 for _, pair in pairs])
    found = _fitted("MAP", terms, right, kind, chosen)
    odds = terms @ map_model.MAP_WEIGHTS + map_model.MAP_CONSTANT
    sizes = np.concatenate(
        [np.full(len(pair["scores"]), pair["in_place"].shape[1]) for _, pair in pairs]
    )
    at_points = np.concatenate([pair["points"].reshape(-1, 2) for _, pair in pairs])
    in_place = np.concatenate([pair["in_place"].ravel() for _, pair in pairs])
    spread = [np.repeat(values, sizes) for values in (odds, kind, chosen)]
    found |= _fitted(
        "POINT", np.column_stack([at_points, spread[0]]), in_place, spread[1], spread[2]
    )

    def share(collection: str, changed: Mapping[str, Constant]) -> float:
        with patched(portfolio, changed):
            return float(np.mean([_is_chosen_right(pair) for pair in drawn[collection]]))

    return found | scan(
        constants_of(portfolio, "ORIENTATION_WEIGHT"), collections, share, quick=quick
    )


def _is_chosen_right(pair: Record) -> bool:
    log_odds = portfolio.support(
        pair["standing"][:, 0], pair["evidence"][:, EVIDENCE.index("orientation")]
    )
    return bool(right_candidates(pair)[np.argmax(log_odds)])


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
    | constants_of(portfolio, "ORIENTATION_WEIGHT"),
    measure=measure_maps,
    collections=(*PAIRS, CUT_BIPEDS),
    score="1 - expected calibration error of chosen maps; of ORIENTATION_WEIGHT the share of them that is right",
)
