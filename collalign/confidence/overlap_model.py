"""From what two surfaces share at a pose to the chance that it is right: a conditional logit with "none is right"."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.features.overlap import FRONT_UNIT, LocalPoses

#: Log-odds of a pose per logarithm of what is explained and of consensus, and of "no pose is right", by whether both
#: surfaces were seen from one direction each. Explained is the overlap where they were, else 1 / (share of the
#: smaller surface without a partner + 0.1): all of a part lies on its whole. The first fitted on depth images,
#: without what is in front, of an armadillo, a teddy bear, a bird and a chair, and on pieces of 20 to 80 % cut off
#: chairs and horses, against their wholes and against another kind of shape. Held back were teeth and generated
#: blobs: mean log loss .44 of 90 pairs of depth images, .15 of 52 pieces (with the overlap of both surfaces .44 and
#: .89) and .18 of 16 pieces on another kind; 67 at .95 or more, none wrong. The second fitted on all pairs of 15
#: depth images each of two teddies, two chairs, an armadillo and a horse: mean log loss .17; without what is in
#: front .74. Each class left out in turn .04 to .40; the most of chairs, whose lines of sight are uncertain.
WEIGHTS = {False: (2.8, 1.2, -0.6), True: (1.3, 1.0, -6.15)}
UNEXPLAINED = 0.1
#: Log-odds against a pose of which a share of points lies in front of what was seen of the other surface: so many
#: times log(1 + share / unit). At right poses the share is 0 to .007. Of wrong ones that overlap by .3, 90 % have
#: .05 or more.
FRONT_WEIGHT = 3.6
#: Shares below this count as this: a match or a point more or less says nothing.
LEAST_SHARE = 0.01
#: No pose of a pair is surer than this: what looks alike may not be the same place.
MOST_CERTAIN = 0.99


def overlap_log_odds(poses: LocalPoses) -> FloatArray:
    """Return the log-odds of poses against that none of them is right, shape (p,)."""
    overlap, consensus = (
        np.log(np.maximum(share, LEAST_SHARE)) for share in (poses.overlap, poses.consensus)
    )
    of_smaller = -np.log(1.0 - poses.overlaps.max(axis=1, initial=0.0) + UNEXPLAINED)
    seen = ~np.isnan(poses.in_front).any(axis=1)
    weights = np.where(seen, *np.array([WEIGHTS[True], WEIGHTS[False]])[:, :, None])
    against = in_front_log_odds(np.where(seen, poses.in_front.max(axis=1, initial=0.0), 0.0))
    explained = np.where(seen, overlap, of_smaller)
    return np.asarray(weights[0] * explained + weights[1] * consensus - weights[2] - against)


def in_front_log_odds(shares: FloatArray) -> FloatArray:
    """Return the log-odds against poses of which shares of points are in front of what was seen, of any shape."""
    return np.asarray(FRONT_WEIGHT * np.log1p(shares / FRONT_UNIT))


def overlap_chances(poses: LocalPoses) -> FloatArray:
    """Return how probable each pose is, shape (p,); what they leave is that none is right."""
    odds = overlap_log_odds(poses)
    top = max(float(odds.max(initial=0.0)), 0.0)
    weights = np.exp(odds - top)
    return np.asarray(np.minimum(weights / (weights.sum() + np.exp(-top)), MOST_CERTAIN))
