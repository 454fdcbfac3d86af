"""From how an incomplete shape lies among complete ones to the odds of its pose, and to whether it is incomplete."""

from __future__ import annotations

import numpy as np

from collalign.confidence.pose_model import LEAST_MISFIT
from data_tools.arrays import FloatArray
from data_tools.poses import AGREE_DEG, pose_angle_deg

#: A shape is incomplete if so much of the surfaces of those that match it best lies beyond its rim. In one draw of 20
#: molars with a quarter cut off six of them, these have .12 to .19, the others at most .05; ``python -m experiments
#: calibrate incomplete`` tries others on molars, skulls, chairs and fish. Beyond the rim is what is nearest to a
#: point of it, and farther than this, in radii of the other shape.
MISSING_SHARE, BEYOND = 0.085, 0.2
#: Sizes are searched up to so many deviations from the complete shapes', of which the next is the least (as a
#: logarithm), and the last the one up to which they say anything: SHREC07's classes, skulls and generated bones have
#: .02 to .12, teeth .3.
KNOWN_SIZES = (2.5, 0.03, 0.2)
#: Weights of the three kinds of evidence of a pose. Fitted on 129 pieces of 10 to 80 % of ants, teddies, chairs,
#: fish, teeth, horses, mouse skulls and two kinds of generated long bones, 44 of them closed at their breaks,
#: each with up to 48 poses on seven complete shapes. Each kind of shape judged by weights fitted without it, 84 % are
#: right on average (of the closed ones 70 %), with a mean log loss of .60. Points without a counterpart that cost
#: the most, unless nearest to a rim, gave 80 % (57 %) and .81. Of 62 at .9 or more none is wrong. Mismatch, overlap,
#: size, and costs of the best 80 % of the points tell no more. ``python -m experiments calibrate fragments`` fits
#: them again on such pieces.
WEIGHTS = (5.5, 28.3, 5.7)
#: Log odds of a pose per logarithm of its energy, where there is but one other shape. Of 96 pairs of which one lacks
#: a quarter (ants, fish, teddies, people, glasses and chairs at even positions, 69 % right) 5, 8, 15 and 30 have mean
#: log losses of .54, .53, .60 and .88.
#: Of 135 pieces like those of the weights above, each on one complete shape, at poses that neighbourhoods propose,
#: a fit gives 8.1: 71 % are right, none wrong of 23 at .9 or more. The costs of either surface, of what is shared,
#: and of what is lost rank no better apart. ``python -m experiments calibrate margins`` measures pairs again.
PAIR_WEIGHT = 8.0
#: A piece may be no part of shapes of this kind if less of it than the first number has a counterpart on them,
#: relative to what they have of each other, and what both share is hardly more alike than they are: the second kind
#: of evidence is above the other number. Of 49 pieces of bones, chairs, teeth, horses and skulls that lie right 15
#: have less than .8. All of these are closed, as a filled break has no counterpart; 14 have -.07 or less. Of 14
#: shapes among others of another kind 12 have less than .8, of which 11 have -.034 or more.
LEAST_LIKENESS, USUAL_EXCESS = 0.8, -0.05
#: A shape that covers less than this share of the others, and has less than this share of its points on a rim, is no
#: piece of their surface, which would have a long rim: it is a body of its own. It resembles none of them where it
#: also mismatches them more than they do each other. None of 18 pieces of 2 to 10 % of bones, chairs and teddies is
#: such, and 7 of 12 molars among them, of a twentieth to a quarter of their size. Held out: none of 6 such pieces of
#: skulls, and 4 of 4 molars among these.
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
    return -np.asarray(WEIGHTS) @ evidence


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
