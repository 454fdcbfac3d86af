"""Maps that are smooth from the start: from poses, and from tips of limbs, matched by how far apart they are.

Where bodies of different kinds have the same limbs, their eigenfunctions have little to do with each other, and rigid
poses lay arms upon trunks. The tips of their limbs are few, and so are the ways to match them.
"""

from __future__ import annotations

import numpy as np

from collalign.nonrigid.functional_map import FunctionalMap, mutual_nearest_rows
from collalign.nonrigid.harmonic import SMOOTHNESS, HarmonicRefiner
from collalign.nonrigid.pose_maps import START_NORMAL_WEIGHT, PoseMapper, start_features
from collalign.nonrigid.surface.tips import Tips
from data_tools.arrays import FloatArray, IntArray

#: Weights of the Dirichlet energy on the way from a rough start.
ANNEALED = tuple(np.geomspace(1e-2, SMOOTHNESS, 8).tolist())
#: Matchings of tips that start maps.
NUM_MATCHINGS = 30
#: Partial matchings that go on to the next tip.
NUM_STATES = 300
#: Price of a tip that is left out, for each of the others: so much as distances cost that differ by a third.
LEFT_OUT = 0.12
#: Weight of a tip's remoteness beside one of its distances to others, and the fewest tips of a matching.
REMOTENESS_WEIGHT, MIN_TIPS = 4.0, 3
#: Distance from a tip, in units of sqrt(area), over which it says less and less.
REACH = 0.2


class SmoothMapper:
    """Smooth maps between two surfaces from rough starts.

    Parameters
    ----------
    mapper : PoseMapper
    """

    def __init__(self, mapper: PoseMapper) -> None:
        self._mapper = mapper
        self._target, self._source = mapper.target, mapper.source
        self._harmonic = HarmonicRefiner(
            self._target.spectral,
            self._source.spectral,
            num_dense=max(len(self._target.points), len(self._source.points)),
            num_functions=len(self._target.spectral.eigenvalues) + 1,
        )

    def map_from(self, R_target_source: FloatArray) -> FunctionalMap:
        """Return the map that closest points at a pose, either determinant, lead to."""
        features = start_features(self._target, np.eye(3)), start_features(self._source, R_target_source)
        return self._annealed(*mutual_nearest_rows(*features))

    def maps_from_tips(self) -> list[FunctionalMap]:
        """Return the maps that matched tips of limbs lead to."""
        return [self._annealed(*start) for start in self.starts_from_tips(NUM_MATCHINGS)]

    def starts_from_tips(self, num: int) -> list[tuple[IntArray, IntArray]]:
        """Return the point maps, there and back, that distances from matched tips ask for, two for each matching.

        The second one also compares the normals at the rotation that the matched tips ask for: on a limb, tips know
        how far it is to its end, but not its front from its back.
        """
        tips = self._target.spectral.tips, self._source.spectral.tips
        starts = []
        for chosen in tip_matchings(*tips, num):
            near = [tip_features(own, matched) for own, matched in zip(tips, chosen, strict=True)]
            plain = mutual_nearest_rows(near[0], near[1])
            rotation = self._mapper.rotation_between(*plain, chirality=1.0)
            normals = self._target.normals, self._source.normals @ rotation.T
            both = [np.hstack([own, START_NORMAL_WEIGHT * facing]) for own, facing in zip(near, normals, strict=True)]
            starts += [plain, mutual_nearest_rows(both[0], both[1])]
        return starts

    def _annealed(self, forward: IntArray, backward: IntArray) -> FunctionalMap:
        return self._harmonic.refine(forward, backward, ANNEALED)


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
