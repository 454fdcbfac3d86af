"""From what two surfaces share at a pose to the chance that it is right: a conditional logit with "none is right"."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.features.overlap import LocalPoses

#: Log-odds of a pose per logarithm of its overlap and of its consensus, and of "no pose is right". Chosen on depth
#: images of an armadillo, a teddy bear, a tooth and a bird. On 278 other pairs of depth images, 24 to 168 degrees
#: apart, of six objects, 33 of the 33 pairs at .95 or more are right within 16 degrees, and 70 of the 74 at .9 or
#: more. Of the three objects on which nothing was chosen (chair, skull, horse), 11 of 11 and 23 of 25; both wrong
#: pairs are of the chair, which is symmetric and flat. Weights fitted on five of the six objects are no better on
#: the sixth: mean log loss .595, for .577 with these. Other columns win nothing: matches weighed by how distinctive
#: their descriptors are have .592 to .605, points inside the other surface that do not agree with it .600 to .665.
#: The mismatch of descriptors has .568, but its weight has the wrong sign.
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
