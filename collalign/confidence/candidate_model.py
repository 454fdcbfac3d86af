"""What evidence says about the poses of a pair: one table of weights, from many kinds of evidence to log-odds.

Every kind of evidence is a disagreement whose noise level nobody knows and which differs from pair to pair, so it
counts by its logarithm (the profile likelihood of the level), and only differences between the poses of one pair
count, up to a limit: no kind may overrule all others. The weights say how independent and how telling the kinds are:
a conditional logit over the poses of a pair.
"""

from __future__ import annotations

import numpy as np

from collalign.confidence.map_model import FLOOR
from collalign.products.pair import Pair
from data_tools.arrays import FloatArray, read_only

#: Kinds of evidence of a pose, in the order of the columns of ``Pair.evidence``.
EVIDENCE = (
    "energy",  # of the samples' best one-to-one match at the pose
    "surface",  # mean squared distance of closest points, normals included
    "normals",  # mean 1 - cosine of the normals of points that the map matches
    "curvature",  # the map's, as in collalign.confidence.map_model.Evidence
    "commutativity",
    "roughness",
    "orientation",  # times the determinant of the pose, so that 1 is right for mirrored poses too
)
#: Log-odds lost per unit of the logarithm of each disagreement, up to :data:`MOST_EXCESS`. Fitted by ``python -m
#: experiments calibrate evidence``.
CANDIDATE_WEIGHTS = {
    "energy": 9.7,
    "surface": 4.7,
    "normals": 5.6,
    "curvature": 8.0,
    "commutativity": 6.6,
    "roughness": 7.2,
}
#: A kind of evidence says no more against a pose than that it is this much (in logarithms) worse than the pair's
#: best: beyond, only the kind itself may not hold for these shapes.
MOST_EXCESS = 0.2
#: Powers of energy and mismatch in the costs of candidates, and what is added to the mismatch. A conditional logit
#: of which candidate is right.
ENERGY_POWER, MISMATCH_POWER, LEAST_MISMATCH = 0.43, 1.29, 0.05
#: Costs count as no smaller than this in logarithms.
LEAST_COST = float(np.finfo(float).tiny)
#: How many times as telling as the logarithms of costs the odds of candidates are, and the log-odds that none is
#: right against the best. Fitted; log-odds of maps are taken as they are.
COST_TRUST, NONE_RIGHT = 24.0, -2.35


def excess_logs(evidence: FloatArray) -> FloatArray:
    """Return by how much each disagreement is worse than the smallest of its kind, in logarithms, shape (m, kinds).

    At most :data:`MOST_EXCESS`, and 0 where unknown; columns are those of :data:`CANDIDATE_WEIGHTS`.

    Parameters
    ----------
    evidence : ndarray, shape (m, len(EVIDENCE))
        Of the poses of one pair, columns as :data:`EVIDENCE` names them; NaN where unknown, which says nothing.
    """
    logs = np.log(
        np.maximum(evidence[:, [EVIDENCE.index(kind) for kind in CANDIDATE_WEIGHTS]], FLOOR)
    )
    least = np.min(logs, axis=0, initial=np.inf, where=~np.isnan(logs))
    return np.nan_to_num(np.minimum(logs - least, MOST_EXCESS))


def evidence_score(evidence: FloatArray) -> FloatArray:
    """Return the log-odds of poses of one pair up to a constant, shape (m,).

    Parameters
    ----------
    evidence : ndarray, shape (m, len(EVIDENCE))
    """
    return np.asarray(-excess_logs(evidence) @ np.array([*CANDIDATE_WEIGHTS.values()]))


def candidate_costs(energies: FloatArray, mismatches: FloatArray) -> FloatArray:
    """Return the cost of each candidate of a pair, from its energy and its neighbourhoods, shape (m,).

    In units of energy: scaled such that the candidate of the lowest energy costs just that. Where a mismatch is not
    known, the energies alone.

    Parameters
    ----------
    energies, mismatches : ndarray, shape (m,)
        As :class:`collalign.products.pair.Pair` has them.
    """
    if len(mismatches) != len(energies) or np.isnan(mismatches).any() or not energies.min() > 0:
        return energies
    best = int(np.argmin(energies))
    ratios = (mismatches + LEAST_MISMATCH) / (mismatches[best] + LEAST_MISMATCH)
    return read_only(
        energies[best] * (energies / energies[best]) ** ENERGY_POWER * ratios**MISMATCH_POWER
    )


def cost_log_odds(costs: FloatArray) -> FloatArray:
    """Return the log-odds of poses of one pair by their costs alone, up to a constant, shape (m,)."""
    return np.asarray(-COST_TRUST * np.log(np.maximum(costs, LEAST_COST)))


def candidate_chances(pair: Pair) -> FloatArray:
    """Return how probable each candidate is by its pair alone, shape (m,); what they leave is that none is right."""
    odds = (
        pair.log_odds
        if len(pair.log_odds)
        else cost_log_odds(candidate_costs(pair.energies, pair.mismatches))
    )
    weights = np.exp(odds - odds.max())
    return read_only(weights / (weights.sum() + np.exp(NONE_RIGHT)))
