"""From evidence to the probability that a pose is right: a logistic model, small enough to read.

It weighs two things. *Agreement* is the geometric mean of a shape's own votes and those of its collection: a shape
that its own pairs contradict is wrong in the best of collections, and votes mean little where all pairs contradict
each other. *Margin* is what the cheapest other pose costs more on dense points.
"""

from __future__ import annotations

import numpy as np

from collalign.products.trust import KINDS, Trust
from data_tools.arrays import FloatArray

#: Limits of agreement and margin: beyond them nothing was seen when the weights were fitted.
LIMITS = np.array([(0.0, 1.0), (-0.3, 0.8)])
#: Their weights, and the constant: fitted on 1296 shapes of 78 runs over eleven real and ten generated
#: collections, as ``python -m experiments calibrate confidence`` does again. With each collection judged by weights
#: fitted without it, 97.9 % of the shapes at .95 or more were right, all of those of real collections (the worst,
#: generated crowns of both sides: 82 %); the calibration error was .018; right shapes ranked above wrong ones of the
#: same run in 76 %; that was before maps started from signs of eigenfunctions as well. Neither the votes of the best
#: partners, nor their decisiveness, nor the spread of margins help.
AGREEMENT_WEIGHT, MARGIN_WEIGHT, CONSTANT = 10.0, 2.5, -5.2
#: A rival whose excess is below this is as good as the reported pose: half turns of boxes, cylinders and spheres.
TIED = 0.02
#: No confidence is stated beyond this: the model itself may be wrong.
MOST_CONFIDENT = 0.995


def terms(evidence: FloatArray) -> FloatArray:
    """Return what the model weighs, shape (N, 2); NaN where nothing is known.

    Parameters
    ----------
    evidence : ndarray, shape (N, len(KINDS))
        As :class:`collalign.products.trust.Trust` holds it.
    """
    votes, margin, collection = (evidence[:, KINDS.index(kind)] for kind in KINDS)
    return np.clip(np.column_stack([np.sqrt(votes * collection), margin]), LIMITS[:, 0], LIMITS[:, 1])


def probability(evidence: FloatArray) -> FloatArray:
    """Return the probability that poses with this evidence are right, shape (N,); NaN where nothing is known.

    Parameters
    ----------
    evidence : ndarray, shape (N, len(KINDS))
    """
    score = terms(evidence) @ [AGREEMENT_WEIGHT, MARGIN_WEIGHT] + CONSTANT
    return np.asarray(np.minimum(1.0 / (1.0 + np.exp(-score)), MOST_CONFIDENT))


def pose_confidence(trust: Trust) -> FloatArray:
    """Return the confidence in each pose, shape (N,): its probability, shared with the rivals that fit as well.

    Parameters
    ----------
    trust : Trust
    """
    ties = np.array([int((excess < TIED).sum()) for excess in trust.excess])
    return np.minimum(probability(trust.evidence), 1.0 / (1.0 + ties))
