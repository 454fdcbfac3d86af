"""From what two surfaces share at a pose to the chance that it is right: a conditional logit with "none is right"."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.features.overlap import LocalPoses

#: Log-odds of a pose per logarithm of its overlap and of its consensus, and of "no pose is right".
OVERLAP_WEIGHT, CONSENSUS_WEIGHT, NONE_RIGHT = 1.3, 1.6, -4.5
#: Shares below this count as this: a match or a point more or less says nothing.
LEAST_SHARE = 0.01
#: No pose of a pair is surer than this: what looks alike may not be the same place.
MOST_CERTAIN = 0.99


def overlap_log_odds(poses: LocalPoses) -> FloatArray:
    """Return the log-odds of poses against each other and against :data:`NONE_RIGHT`, shape (p,)."""
    shares = np.log(np.maximum(poses.overlap, LEAST_SHARE)), np.log(np.maximum(poses.consensus, LEAST_SHARE))
    return OVERLAP_WEIGHT * shares[0] + CONSENSUS_WEIGHT * shares[1]


def overlap_chances(poses: LocalPoses) -> FloatArray:
    """Return how probable each pose is, shape (p,); what they leave is that none is right."""
    odds = overlap_log_odds(poses)
    top = max(float(odds.max(initial=NONE_RIGHT)), NONE_RIGHT)
    weights = np.exp(odds - top)
    return np.asarray(np.minimum(weights / (weights.sum() + np.exp(NONE_RIGHT - top)), MOST_CERTAIN))
