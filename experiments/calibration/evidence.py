"""The weights of the evidence for poses: a conditional logit of which pose of a pair is right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from collalign.confidence import candidate_model as odds
from collalign.options import AlignOptions
from collalign.stages.evidence import candidates, weigh
from data_tools.arrays import BoolArray, FloatArray
from data_tools.rotations import rotation_angle_deg
from experiments.calibration.matched import matched
from experiments.calibration.scan import Calibration, Finding, patched

#: A pose within this angle of the landmarks' is right.
RIGHT_DEG = 25.0
#: Shapes of each collection, all pairs of which are weighed, and poses kept of a pair: all.
NUM_SHAPES, NUM_QUICK, MOST_POSES = 20, 3, 100
#: Half the precision of the weights, beside log-likelihoods summed over so many pairs a collection.
RIDGE, PAIRS_A_CLASS = 0.01, 190


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedPair:
    """What ``excess_logs`` says of the poses of a pair, shape (m, kinds), and which poses are right."""

    logs: FloatArray
    right: BoolArray


def weighed_pairs(data: Path, collection: str, quick: bool) -> list[WeighedPair]:
    """Weigh the poses of all pairs of some shapes; of use are pairs that have right ones and wrong ones."""
    found = []
    options = AlignOptions(group="SO", maps="always")
    with (
        patched(candidates, {"MAX_CANDIDATES": max(MOST_POSES, candidates.MAX_CANDIDATES)}),
        matched(data, collection, NUM_QUICK if quick else NUM_SHAPES, options) as all_pairs,
    ):
        at = [all_pairs.posed.names.index(name) for name in all_pairs.shapes.names]
        for pair in weigh.weigh_pairs(all_pairs.session, all_pairs.shapes, all_pairs.pairs):
            able = np.isfinite(pair.log_odds)
            truth = all_pairs.posed.relative[at[pair.target], at[pair.source]]
            right = np.asarray(rotation_angle_deg(pair.rotations[able, :3, :3], truth)) <= RIGHT_DEG
            found.append(WeighedPair(logs=odds.excess_logs(pair.evidence[able]), right=right))
    return [pair for pair in found if pair.right.any() and not pair.right.all()]


def fit_logit(drawn: Sequence[Sequence[WeighedPair]]) -> FloatArray:
    """Return the weights, none negative, under which the right poses are likeliest; collections count alike."""

    def loss(weights: FloatArray) -> tuple[float, FloatArray]:
        total, slope = RIDGE * float(weights @ weights), 2.0 * RIDGE * weights
        for pairs in drawn:
            for pair in pairs:
                scores = -pair.logs @ weights
                every, right = logsumexp(scores), logsumexp(scores[pair.right])
                total += PAIRS_A_CLASS / len(pairs) * float(every - right)
                change = (
                    np.exp(scores[pair.right] - right) @ pair.logs[pair.right]
                    - np.exp(scores - every) @ pair.logs
                )
                slope = slope + PAIRS_A_CLASS / len(pairs) * change
        return total, slope

    num = len(odds.CANDIDATE_WEIGHTS)
    fitted = minimize(loss, np.ones(num), jac=True, method="L-BFGS-B", bounds=[(0.0, None)] * num)
    return np.asarray(fitted.x)


def share_right(pairs: Sequence[WeighedPair], weights: FloatArray) -> float:
    """Return the share of the pairs whose likeliest pose is right."""
    return float(np.mean([pair.right[np.argmin(pair.logs @ weights)] for pair in pairs]))


def measure_odds(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights, on all collections and without each of them."""
    drawn = {collection: weighed_pairs(data, collection, quick) for collection in collections}
    drawn = {collection: pairs for collection, pairs in drawn.items() if pairs}
    weights = fit_logit(list(drawn.values()))
    code = np.array(list(odds.CANDIDATE_WEIGHTS.values()))
    without = [
        share_right(pairs, fit_logit([found for other, found in drawn.items() if other != one]))
        for one, pairs in drawn.items()
    ]
    shares = [
        float(np.mean([share_right(pairs, some) for pairs in drawn.values()]))
        for some in (code, weights)
    ]
    return {
        kind: Finding(
            value=float(weight), now=shares[0], best=shares[1], left_out=float(np.mean(without))
        )
        for kind, weight in zip(odds.CANDIDATE_WEIGHTS, weights, strict=True)
    }


CALIBRATION = Calibration(
    module=odds.__name__,
    constants=dict(odds.CANDIDATE_WEIGHTS),
    measure=measure_odds,
    collections=("human", "ant", "armadillo", "glasses", "fish", "bird", "plane", "teddy"),
    score=f"share of pairs whose likeliest pose is within {RIGHT_DEG:.0f} degrees, all weights together",
)
