"""Maps that are smooth from the start: from poses, and from tips of limbs."""

from __future__ import annotations

import numpy as np

from collalign.nonrigid.functional_map import FunctionalMap, mutual_nearest_rows
from collalign.nonrigid.harmonic import SMOOTHNESS, HarmonicRefiner
from collalign.nonrigid.pose_maps import START_NORMAL_WEIGHT, PoseMapper, start_features
from collalign.nonrigid.starts.matched_tips import tip_features, tip_matchings
from data_tools.arrays import FloatArray, IntArray

#: Weights of the Dirichlet energy on the way from a rough start.
ANNEALED = tuple(np.geomspace(1e-2, SMOOTHNESS, 8).tolist())
#: Matchings of tips that start maps.
NUM_MATCHINGS = 30


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
