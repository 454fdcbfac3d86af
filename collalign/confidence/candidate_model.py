"""What evidence says about the poses of a pair: one table of weights, from many kinds of evidence to log-odds.

Every kind of evidence is a disagreement whose noise level nobody knows and which differs from pair to pair, so it
counts by its logarithm (the profile likelihood of the level), and only differences between the poses of one pair
count. The weights say how independent and how telling the kinds are: a conditional logit over the poses of a pair.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

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
#: Log-odds lost per unit of the logarithm of each disagreement: a conditional logit of which pose of a pair is within
#: 25 deg of the landmarks', over the 190 pairs each of SHREC07's humans, ants, armadillos and glasses, about 27 poses
#: a pair, rounded. Orientation adds nothing to the others there. ``python -m experiments calibrate evidence`` fits
#: them again, as well as without each class. Normals of matched points had 3.0, which turned planes by half (13 of 20
#: right); a fit over eight classes, equal weight a class, leaves them 1.1 beside an energy of 4. Share of the pairs
#: whose likeliest pose is right, with 3.0, with 1.0 and without: planes .61, .71, .83; humans .82, .80, .68; glasses
#: .95, .91, .88; ants .86, .89, .91; armadillos, birds, fish and teddy bears alike within .01.
WEIGHTS = {
    "energy": 4.0,
    "surface": 1.8,
    "normals": 1.0,
    "curvature": 2.7,
    "commutativity": 3.6,
    "roughness": 3.8,
}
#: Floor of a disagreement inside its logarithm.
FLOOR = 1e-3
#: Costs count as no smaller than this in logarithms.
LEAST_COST = float(np.finfo(float).tiny)
#: How many times as telling as the logarithms of costs, and the log-odds of maps, the odds of candidates are, and the
#: log-odds that none is right against the best: fitted on 10 920 pairs of 151 runs over 22 collections, those right
#: that are within 25 deg of the final poses of two shapes that are within 20 of the truth. With each collection
#: left out, stated and right differ by .10 (costs, which say too little) and .04 (maps) on average, and of the
#: likeliest candidates at .9 or more 98 and 95 % are right.
COST_TRUST, MAP_TRUST, NONE_RIGHT = 24.0, 1.4, -2.35


def evidence_score(evidence: FloatArray, kinds: Collection[str] = WEIGHTS) -> FloatArray:
    """Return the log-odds of poses of one pair up to a constant, shape (m,).

    Parameters
    ----------
    evidence : ndarray, shape (m, len(EVIDENCE))
        Columns as :data:`EVIDENCE` names them; NaN where unknown, which says nothing.
    kinds : collection of str
        Those that count; all that have a weight by default.
    """
    columns = [EVIDENCE.index(kind) for kind in kinds]
    logs = np.log(np.maximum(evidence[:, columns], FLOOR))
    return np.asarray(-np.nan_to_num(logs) @ np.array([WEIGHTS[kind] for kind in kinds]))


def candidate_chances(pair: Pair) -> FloatArray:
    """Return how probable each candidate is by its pair alone, shape (m,); what they leave is that none is right."""
    costs = np.maximum(pair.costs, LEAST_COST)
    odds = MAP_TRUST * pair.log_odds if len(pair.log_odds) else -COST_TRUST * np.log(costs)
    weights = np.exp(odds - odds.max())
    return read_only(weights / (weights.sum() + np.exp(NONE_RIGHT)))
