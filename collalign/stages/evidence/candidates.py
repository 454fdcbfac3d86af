"""Candidate poses of a pair that its maps ask for, each with what every kind of evidence says of it.

Poses of maps on few samples are right for four of five pairs of bodies, which a collection outvotes. Surfaces of
doubtful shapes are laid onto those of the others from their rivals (:mod:`collalign.stages.evidence.weigh`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import scipy

from collalign.confidence.candidate_model import EVIDENCE, evidence_score
from collalign.confidence.map_model import Evidence
from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import candidates_from, chirality_of
from collalign.nonrigid.pose_maps import MAX_FACES, NUM_SIGN_MAPS, PoseMapper, sampled_surface
from collalign.nonrigid.spectral_shape import SpectralShape, prepare_surface
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import CleaningOptions
from data_tools.poses import SAME_DEG, keep_apart

#: Candidates kept, those of the best evidence.
MAX_CANDIDATES = 10
#: Surfaces that are laid onto each other. With 60 functions, 400 samples and 6000 triangles pairs take half as long
#: again, and the right pose is first in 186 instead of 184 of 228 doubtful pairs of planes, SCAPE, humans, birds and
#: armadillos. Nothing asks for geodesic samples.
LAID = SurfaceOptions(num_functions=50, num_samples=8, num_dense=300, max_faces=MAX_FACES // 2)
#: Surfaces that a worker keeps.
_NUM_KEPT = 32

#: A pose (3, 3) that a map asks for, the samples' best one-to-one match there (k,), and the evidence of both, in the
#: order of :data:`collalign.confidence.candidate_model.EVIDENCE`.
WeighedPose: TypeAlias = tuple[FloatArray, IntArray, FloatArray]


class PoseWeigher:
    """Weighs poses of one pair.

    Parameters
    ----------
    target, source : Samples
    mapper : PoseMapper
        Of their surfaces.
    """

    def __init__(self, target: Samples, source: Samples, mapper: PoseMapper) -> None:
        self._target, self._source, self._mapper = target, source, mapper
        self._fixed_costs = scipy.spatial.distance.cdist(
            source.invariants, target.invariants, "sqeuclidean"
        )

    def candidate_from(self, start: FloatArray) -> WeighedPose:
        """Return the pose of the map that a pose (3, 3) leads to, with its evidence."""
        found = self._mapper.map_from(start)
        return self.weigh(
            found, self._mapper.evidence(found), chirality=float(np.sign(np.linalg.det(start)))
        )

    def candidates_from_signs(self, *, mirrored: bool) -> list[WeighedPose]:
        """Return the poses of maps that eigenfunctions start; maps that swap sides ask for mirrored poses, if any.

        Half as many as a single match refines hold the right pose as often, 97 % of 475 pairs of five classes.
        """
        found = [
            (self._mapper.evidence(one), one)
            for one in self._mapper.maps_from_signs(NUM_SIGN_MAPS // 2)
        ]
        return [
            self.weigh(one, of_map, chirality=-1.0 if of_map.orientation < 0 else 1.0)
            for of_map, one in found
            if mirrored or not of_map.orientation < 0
        ]

    def weigh(self, found: FunctionalMap, of_map: Evidence, *, chirality: float) -> WeighedPose:
        """Return the pose of determinant ``chirality`` that a map asks for, with the evidence of both."""
        rotation = self._mapper.rotation_of(found, chirality=chirality)
        costs = (
            scipy.spatial.distance.cdist(
                self._source.positions @ rotation.T, self._target.positions, "sqeuclidean"
            )
            + self._fixed_costs
        )
        rows, columns = scipy.optimize.linear_sum_assignment(costs)
        evidence = vars(of_map) | {
            "energy": float(costs[rows, columns].sum()),
            "surface": self._mapper.surface_gap(rotation),
            "normals": self._mapper.normal_gap(found, rotation),
            "orientation": chirality * of_map.orientation,
        }
        return rotation, columns.astype(np.int64), np.array([evidence[kind] for kind in EVIDENCE])


def distinct_weighed(candidates: Sequence[WeighedPose]) -> list[WeighedPose]:
    """Return the candidates of the best evidence, best first, only one of each set of nearly equal rotations."""
    scores = evidence_score(np.stack([evidence for _, _, evidence in candidates]))
    ranked = [candidates[at] for at in np.argsort(-scores, kind="stable")]
    rotations = np.stack([rotation for rotation, _, _ in ranked])
    return [ranked[at] for at in keep_apart(rotations, SAME_DEG, num=MAX_CANDIDATES)]


#: Share of the area of all pieces that the largest one of a surface must have: only that is laid.
LEAST_SHARE = 0.9


def laid_surfaces(
    files: Iterable[Mapping[str, Any]], areas: Iterable[float]
) -> list[SpectralShape]:
    """Return surfaces to lay onto each other, none where one is in pieces: only the largest would be seen.

    Files are what :func:`collalign.stages.evidence.map_surfaces.prepare_surface_file` takes; areas are of all pieces.
    """
    try:
        found = [_prepared(**file) for file in files]
    except InputError:
        return []
    return (
        found
        if all(one.area >= LEAST_SHARE * area for one, area in zip(found, areas, strict=True))
        else []
    )


def candidates_laid(
    target: Samples,
    source: Samples,
    surfaces: Sequence[SpectralShape],
    group: str,
    starts: FloatArray,
) -> list[WeighedPose]:
    """Return poses of a pair that maps ask for which lay its surfaces onto each other from some starts (m, 3, 3)."""
    to, of = surfaces
    options = NonrigidOptions(orientation="any" if group == "O" else "preserving")
    found = candidates_from(to, of, starts, options)
    weigher = PoseWeigher(target, source, PoseMapper(sampled_surface(to), sampled_surface(of)))
    return [
        weigher.weigh(one.functional_map, one.evidence, chirality=chirality_of(one, options))
        for one in found
    ]


@lru_cache(maxsize=_NUM_KEPT)
def _prepared(path: Origin, name: str, digest: str, cleaning: CleaningOptions) -> SpectralShape:
    return prepare_surface(read_shape(path, cleaning, name=name, digest=digest), LAID)
