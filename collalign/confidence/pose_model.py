"""From evidence to the probability that a pose is right: a logistic model, small enough to read.

It weighs four things. *Agreement* is the geometric mean of a shape's own votes and those of its collection: a shape
that its own pairs contradict is wrong in the best of collections, and votes mean little where all pairs contradict
each other. *Margin* is what the cheapest other pose costs more on dense points, *local margin* the same by the
descriptors of neighbourhoods. *Lead* is how much less plausible the pairs themselves find the strongest rival: where
votes are split among many poses, the first of them may still be far ahead. *Misfit*, *mismatch* and few *partners*
limit what is stated.
"""

from __future__ import annotations

import numpy as np

from collalign.products.trust import (
    BLOCK_MARGIN,
    COLLECTION_VOTES,
    CYCLES,
    LEAD,
    LOCAL_MARGIN,
    LOCAL_MISFIT,
    MARGIN,
    MISFIT,
    MISMATCH,
    UNCERTAIN,
    VOTES,
    Trust,
)
from data_tools.arrays import BoolArray, FloatArray

#: Limits of agreement, margin, local margin and lead: beyond them nothing was seen when the weights were fitted.
LIMITS = np.array([(0.0, 1.0), (-0.3, 0.8), (-0.3, 0.8), (-2.0, 4.0)])
#: Their weights, and the constant. Fitted by ``python -m experiments calibrate confidence``; local margin and
#: margin share the weight of the margin as in a logistic model of which of two poses is right.
AGREEMENT_WEIGHT, MARGIN_WEIGHT, LOCAL_WEIGHT, LEAD_WEIGHT = 10.0, 1.6, 1.4, 0.6
POSE_CONSTANT = -5.85
POSE_WEIGHTS = np.array([AGREEMENT_WEIGHT, MARGIN_WEIGHT, LOCAL_WEIGHT, LEAD_WEIGHT])
#: No more is stated than a logistic model of two things allows, or half of what is above :data:`UNCERTAIN`: of
#: :func:`cycle_log_odds`, and of the block margin. Its constant and weights. Few shapes may all agree on a wrong
#: pose, and so do many of which a block is rotated: their pairs err together, so that log-odds above the second
#: number count as that. Where cycles tell nothing, as among three shapes, more than :data:`UNCERTAIN` is stated
#: only if the local margin is at least the last number.
LIMIT_WEIGHTS, MOST_CYCLES, LEAST_LOCAL = np.array([2.8, 0.3, 3.0]), 5.0, 0.26
#: A rival whose excess is below this, and over which the lead is below that, is as good as the reported pose: half
#: turns of boxes, cylinders and spheres.
TIED, TIED_LEAD = 0.02, 1.0
#: Turns after which the shapes of a part cost so little more, on average over them, and over which their pairs lead
#: by less than :data:`TIED_LEAD`, leave the part as it is.
ALIKE = 0.04
#: The mismatch of a shape's neighbourhoods with its own after such a turn, at most.
ALIKE_MISMATCH = 0.41
#: A shape resembles no other where the mismatch with its most similar partner (1 is chance) exceeds the first,
#: after a share of its misfit was added: that is the log of the mismatch over the median shape's, which exceeds the
#: third.
STRANGE, MISFIT_SHARE, LEAST_MISFIT = 1.0, 0.15, 0.4
#: Chances of a pair to be right, evenly spaced, over which the odds of :func:`cycle_log_odds` are averaged.
NUM_CHANCES = 500
#: No confidence is stated beyond this: the model itself may be wrong.
MOST_CONFIDENT = 0.995


def terms(evidence: FloatArray) -> FloatArray:
    """Return what the model weighs, shape (N, 4); NaN where nothing is known.

    Where neighbourhoods are not known, dense points stand for them.

    Parameters
    ----------
    evidence : ndarray, shape (N, len(KINDS))
        As :class:`collalign.products.trust.Trust` holds it.
    """
    votes, margin, collection, lead, local = evidence[
        :, [VOTES, MARGIN, COLLECTION_VOTES, LEAD, LOCAL_MARGIN]
    ].T
    local = np.where(np.isnan(local), margin, local)
    seen = np.column_stack([np.sqrt(votes * collection), margin, local, lead])
    return np.clip(seen, LIMITS[:, 0], LIMITS[:, 1])


def cycle_log_odds(
    num_shapes: int, num_pairs: int, num_contradicted: float, *, num_poses: float = 2.0
) -> float:
    """Return the log-odds that pairs know the poses of shapes, by how many of them the best poses contradict.

    Pairs that know nothing choose one of m poses at random, so each agrees with a chance of 1/m. But there are
    m^(n-1) ways to pose n shapes, and where n is small the best of them agrees with many pairs: of three shapes and
    two poses with all pairs in every second case. Pairs that know the poses are right with a chance that is not
    known, between 1/m and one, and else choose another pose at random. Both are equally likely before.

    Parameters
    ----------
    num_shapes, num_pairs : int
    num_contradicted : float
        Of the pairs, by the reported poses.
    num_poses : float
        Poses that pairs choose among, m.
    """
    right = (1.0 + (num_poses - 1.0) * (np.arange(NUM_CHANCES) + 0.5) / NUM_CHANCES) / num_poses
    wrong = (1.0 - right) / (num_poses - 1.0)
    agreed = num_pairs - num_contradicted
    over_random = agreed * np.log(num_poses * right) + num_contradicted * np.log(num_poses * wrong)
    mean = np.logaddexp.reduce(over_random) - np.log(NUM_CHANCES)
    return float(mean - (num_shapes - 1) * np.log(num_poses))


def resembles_none(evidence: FloatArray) -> BoolArray:
    """Return which shapes match no other one much better than chance, shape (N,), compared with the median shape.

    Parameters
    ----------
    evidence : ndarray, shape (N, len(KINDS))
    """
    mismatch, misfit = evidence[:, [MISMATCH, LOCAL_MISFIT]].T
    return np.asarray((mismatch + MISFIT_SHARE * misfit > STRANGE) & (misfit > LEAST_MISFIT))


def half_sure(chances: FloatArray) -> FloatArray:
    """Return chances (N,) with half of what each has above :data:`UNCERTAIN`: in doubt, and in the same order."""
    return np.minimum(chances, UNCERTAIN + 0.5 * np.maximum(chances - UNCERTAIN, 0.0))


def limited(evidence: FloatArray, chances: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return what is stated of poses with chances by the weights alone (N,), and the code of what limits each.

    What limits a confidence keeps the order of the chances, so that right and wrong poses do not share one number:

    * ``no-relative``: the shape resembles no other one; half of the chance.
    * ``contradicted``: points and neighbourhoods would both rather have it in another pose; half of the chance.
    * ``block``: a block of shapes may be rotated as one. No more than :data:`LIMIT_WEIGHTS` say, which see how few
      shapes there are, whether their pairs contradict each other, and what tells the block's poses apart.
    * ``misfit``: it exceeds twice the margin, so that how badly the shape fits outweighs what tells its poses apart.
      Its pairs may all say the same, but they compare what hardly compares.
    * ``few-shapes``: neither cycles nor neighbourhoods tell poses apart.

    The last three leave half of what a chance has above :data:`UNCERTAIN`.

    Parameters
    ----------
    evidence : ndarray, shape (N, len(KINDS))
    chances : ndarray, shape (N,)
    """
    kinds = [MARGIN, MISFIT, LOCAL_MARGIN, CYCLES, BLOCK_MARGIN]
    margin, misfit, local, cycles, block = evidence[:, kinds].T
    of_blocks = LIMIT_WEIGHTS @ [np.ones(len(cycles)), np.minimum(cycles, MOST_CYCLES), block]
    halved = half_sure(chances)
    always = np.ones(len(chances), dtype=np.bool_)
    limits = (
        ("block", always, np.maximum(1.0 / (1.0 + np.exp(-of_blocks)), halved)),
        ("misfit", misfit > 2.0 * np.maximum(margin, TIED), halved),
        ("few-shapes", (cycles < 0.0) & (local < LEAST_LOCAL), halved),
        ("contradicted", np.maximum(margin, local) < 0.0, 0.5 * chances),
        ("no-relative", resembles_none(evidence), 0.5 * chances),
    )
    stated, codes = chances, np.full(len(chances), "", dtype="U16")
    for code, applies, most in limits:
        binds = applies & (most < stated)
        stated, codes = np.where(binds, most, stated), np.where(binds, code, codes)
    return stated, tuple(codes.tolist())


def _limited(evidence: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    score = terms(evidence) @ POSE_WEIGHTS + POSE_CONSTANT
    return limited(evidence, np.minimum(1.0 / (1.0 + np.exp(-score)), MOST_CONFIDENT))


def probability(evidence: FloatArray) -> FloatArray:
    """Return how probably poses with evidence (N, len(KINDS)) are right, shape (N,); NaN where nothing is known."""
    return _limited(evidence)[0]


def pose_confidence(trust: Trust) -> FloatArray:
    """Return the confidence in each pose, shape (N,): its probability, shared with the rivals that fit as well.

    Where turns leave a whole part as it is, no pose is likelier than any other that they lead to.
    """
    return confidence_and_limits(trust)[0]


def confidence_and_limits(trust: Trust) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the confidence in each pose, shape (N,), and the code of what limits it, empty where nothing does.

    Codes are those of :func:`limited`, and ``symmetry`` where other poses look alike.
    """
    ties = [
        ((own < TIED) & (over < TIED_LEAD)).sum()
        for own, over in zip(trust.excess, trust.leads, strict=True)
    ]
    alike = np.array([len(turns) for turns in trust.symmetries])
    alone, codes = _limited(trust.evidence)
    single = np.minimum(alone, 1.0 / (1.0 + np.array(ties)))
    shared = symmetric_confidence(trust) / np.maximum(alike, 1)
    stated = np.where(alike > 1, np.minimum(single, shared), single)
    named = np.where(stated < alone, "symmetry", np.array(codes, dtype="U16"))
    return stated, tuple(named.tolist())


def symmetric_confidence(trust: Trust) -> FloatArray:
    """Return the confidence in each pose up to the turns that leave its part as it is, shape (N,)."""
    return probability(trust.up_to_symmetry)


def noise_of_excess(num_points: int, num_partners: int) -> float:
    """Return the standard deviation of the log of what two poses of a table of points cost, if both are right.

    Its points and those of each partner lie off their true places by independent normal noise of one size s. At
    either pose their mean squared distance is 6 s^2, but for the mean product of both noises: that is all that
    differs, and has variance 3 s^4 / (n p) over n points and p partners. So the difference of twice this, over
    6 s^2, has variance 2 / (3 n p).

    Parameters
    ----------
    num_points, num_partners : int
    """
    return float(np.sqrt(2.0 / (3.0 * num_points * num_partners)))


def is_as_good(
    excess: FloatArray,
    leads: FloatArray,
    own_mismatch: FloatArray,
    usual_mismatch: float,
    noise: float = 0.0,
) -> BoolArray:
    """Return after which turns of a part its shapes fit as well, shape (t,).

    Parameters
    ----------
    excess, leads, own_mismatch : ndarray, shape (t,)
        Means over the shapes of the part; the last is the mismatch of neighbourhoods of a turned shape with itself as
        it lies, NaN where it is not known.
    usual_mismatch : float
        Mean mismatch of the shapes with their partners, which no symmetry needs to be below; NaN as well.
    noise : float
        What noise alone makes of the excess of tables, as :func:`noise_of_excess`: twice of it says nothing.
    """
    differs = own_mismatch > np.fmax(usual_mismatch, ALIKE_MISMATCH)
    return np.asarray((excess < max(ALIKE, 2.0 * noise)) & (leads < TIED_LEAD) & ~differs)
