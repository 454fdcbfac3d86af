"""From how an incomplete shape lies among complete ones to the odds of its pose, and to whether it is incomplete."""

from __future__ import annotations

import numpy as np

from collalign.confidence.pose_model import LEAST_MISFIT
from data_tools.arrays import FloatArray
from data_tools.poses import AGREE_DEG, pose_angle_deg

#: A shape is incomplete if so much of the surfaces of those that match it best lies beyond its rim (``python -m
#: experiments calibrate incomplete``): what is nearest to a point of it, and farther than this, in radii of the
#: other shape.
MISSING_SHARE, BEYOND = 0.085, 0.2
#: Sizes are searched up to so many deviations from the complete shapes', of which the next is the least (as a
#: logarithm), and the last the one up to which they say anything.
KNOWN_SIZES = (2.5, 0.03, 0.2)
#: Weights of the three kinds of evidence of a pose. Fitted by ``python -m experiments calibrate fragments``.
PIECE_WEIGHTS = (5.5, 28.3, 5.7)
#: Log odds of a pose per logarithm of its energy, where there is but one other shape (``python -m experiments
#: calibrate margins``).
PAIR_WEIGHT = 8.0
#: A piece may be no part of shapes of this kind if less of it than the first number has a counterpart on them,
#: relative to what they have of each other, and the second kind of evidence is above the other number: what both
#: share is hardly more alike than they are.
LEAST_LIKENESS, USUAL_EXCESS = 0.8, -0.05
#: A shape that covers less than this share of the others, and has less than this share of its points on a rim, is
#: no piece of their surface, which would have a long rim: it is a body of its own. It resembles none of them where
#: it also mismatches them more than they do each other.
LITTLE = 0.15


def log_odds(evidence: FloatArray) -> FloatArray:
    """Return the log-odds of poses against each other (p,).

    Parameters
    ----------
    evidence : ndarray, shape (3, p)
        Mean logarithm of what the shape's points cost on all complete shapes; by how much more theirs cost on it than
        on each other, mean of logarithms, nothing where it has no counterpart; the share of theirs that it lacks
        though it has no rim there.
    """
    return -np.asarray(PIECE_WEIGHTS) @ evidence


def share_of_best(turns: FloatArray, odds: FloatArray) -> float:
    """Return the chance that the first of poses, turns (m, 3, 3), is right: the share of its like, at most .993."""
    chances = np.exp(odds - odds.max())
    alike = pose_angle_deg(turns, turns[0]) <= AGREE_DEG
    return float(min(chances[alike].sum() / chances.sum(), 0.993))


def is_unlike(mismatch: float, likeness: float, excess: float) -> bool:
    """Return whether nothing tells that a piece is a part of shapes of this kind, so that its pose is in doubt.

    Parameters
    ----------
    mismatch : float
        Of its neighbourhoods; NaN where there are too few.
    likeness : float
        Share of it with a counterpart, relative to complete shapes on each other; NaN where there is but one.
    excess : float
        The second kind of evidence of its pose, see :func:`log_odds`.
    """
    is_elsewhere = likeness < LEAST_LIKENESS and excess > USUAL_EXCESS
    return bool(np.isnan(mismatch) or is_elsewhere)


def is_other_body(coverage: float, on_rim: float, misfit: float) -> bool:
    """Return whether a shape that was posed as a piece is a body of another kind.

    Parameters
    ----------
    coverage : float
        Share of the others that it covers.
    on_rim : float
        Share of its points that lie on its rim.
    misfit : float
        Logarithm of its mismatch over that of the median complete shape; NaN where it is not known.
    """
    return max(coverage, on_rim) < LITTLE and misfit > LEAST_MISFIT


def chance_against(chance: FloatArray, rival: FloatArray) -> FloatArray:
    """Return how probable poses (m,) are which other evidence contradicts: both cannot be right, both may be wrong.

    Parameters
    ----------
    chance, rival : ndarray, shape (m,)
        How probable each of the two is by its own evidence.
    """
    left = chance * (1.0 - rival)
    return np.asarray(left / (left + 1.0 - chance))
