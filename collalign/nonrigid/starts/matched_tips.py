"""Maps that start from the tips of limbs, matched by how far apart they are along the surfaces.

Where bodies of different kinds have the same limbs, their eigenfunctions have little to do with each other, and rigid
poses lay arms upon trunks. The tips of their limbs are few, and so are the ways to match them.
"""

from __future__ import annotations

import numpy as np

from collalign.nonrigid.surface.tips import Tips
from data_tools.arrays import FloatArray, IntArray

#: Partial matchings that go on to the next tip.
NUM_STATES = 300
#: Price of a tip that is left out, for each of the others: so much as distances cost that differ by a third.
LEFT_OUT = 0.12
#: Weight of a tip's remoteness beside one of its distances to others, and the fewest tips of a matching.
REMOTENESS_WEIGHT, MIN_TIPS = 4.0, 3
#: Distance from a tip, in units of sqrt(area), over which it says less and less.
REACH = 0.2


def tip_matchings(target: Tips, source: Tips, num: int) -> list[tuple[IntArray, IntArray]]:
    """Return the best partial matchings of tips, best first, each as positions of target and source tips.

    Least is the sum of the squared logarithms of the ratios of distances between matched tips and of their
    remoteness, and a price for tips that are left out, by beam search.

    Parameters
    ----------
    target, source : Tips
    num : int
        At most.
    """
    t, s = len(target), len(source)
    pairs = (_logarithm(target.between)[:, :, None, None] - _logarithm(source.between)) ** 2
    singles = REMOTENESS_WEIGHT * (target.remoteness[:, None] - source.remoteness) ** 2
    states, costs = np.empty((1, 0), dtype=np.int64), np.zeros(1)
    for tip in range(s):
        added = np.tile(singles[:, tip], (len(states), 1))
        for other in range(tip):
            at = states[:, other]
            known = np.flatnonzero(at >= 0)
            added[known] += pairs[:, at[known], tip, other].T
            added[known, at[known]] = np.inf
        total = costs[:, None] + np.column_stack([added, np.full(len(states), LEFT_OUT * (s - 1))])
        best = np.argsort(total, axis=None, kind="stable")[:NUM_STATES]
        best = best[np.isfinite(total.ravel()[best])]
        row, column = np.divmod(best, t + 1)
        states = np.column_stack([states[row], np.where(column < t, column, -1)])
        costs = total.ravel()[best]
    matched = states >= 0
    able = np.flatnonzero(matched.sum(axis=1) >= MIN_TIPS)[:num]
    return [(states[i][matched[i]], np.flatnonzero(matched[i])) for i in able]


def tip_features(tips: Tips, chosen: IntArray) -> FloatArray:
    """Return how near the dense samples are to chosen tips, shape (n, m)."""
    return np.asarray(np.exp(-tips.distances[:, chosen] / REACH))


def _logarithm(distances: FloatArray) -> FloatArray:
    return np.log(distances + np.eye(len(distances)))
