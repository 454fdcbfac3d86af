"""Pairs of small collections, each searched like a match of two shapes: few others can contradict a wrong one there.

Poses of maps on few samples (:mod:`collalign.stages.evidence.weigh`) are right for four of five pairs of bodies,
which a large collection outvotes. Here maps start from within as well, and the surfaces are laid onto each other.
Doubtful shapes of larger collections start from their rivals alone (:mod:`collalign.stages.evidence.weigh`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from collalign.confidence.map_model import RIGHT_SHARE
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import candidates_from, chirality_of, find_candidates
from collalign.nonrigid.pose_maps import MAX_FACES, PoseMapper, sampled_surface
from collalign.nonrigid.spectral_shape import SpectralShape, prepare_surface
from collalign.stages.evidence.candidates import PoseWeigher, WeighedPose
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import CleaningOptions

#: Collections of at most so many shapes are searched: 28 pairs of .9 s. Of 216 shapes in 36 sixes of SCAPE and of
#: SHREC07's humans and armadillos, on which this was chosen, 8 are beyond 20 deg, 19 without.
MOST_SEARCHED = 8
#: Surfaces of a search. With 60 functions, 400 samples and 6000 triangles pairs take half as long again, and the
#: right pose is first in 186 instead of 184 of 228 doubtful pairs of planes, SCAPE, humans, birds and armadillos.
SEARCHED = SurfaceOptions(num_functions=50, num_dense=300, max_faces=MAX_FACES // 2)
#: The same where poses are the starts: nothing asks for geodesic samples there.
STARTED = replace(SEARCHED, num_samples=8)


def searched_surfaces(
    files: Iterable[Mapping[str, Any]], areas: Iterable[float], options: SurfaceOptions
) -> list[SpectralShape]:
    """Return surfaces prepared for a search, none where one is in pieces: a search would see only the largest.

    Files are what :func:`collalign.stages.evidence.map_surfaces.prepare_surface_file` takes; areas are of all pieces.
    """
    try:
        found = [_prepared(options, **file) for file in files]
    except InputError:
        return []
    return (
        found
        if all(one.area >= RIGHT_SHARE * area for one, area in zip(found, areas, strict=True))
        else []
    )


def search_pair(
    target: Samples,
    source: Samples,
    surfaces: Sequence[SpectralShape],
    group: str,
    starts: FloatArray | None,
) -> list[WeighedPose]:
    """Return poses of a pair that a search proposes, or those that maps from some starts (m, 3, 3) ask for."""
    to, of = surfaces
    options = NonrigidOptions(orientation="any" if group == "O" else "preserving")
    found = (
        find_candidates(to, of, options)
        if starts is None
        else candidates_from(to, of, starts, options)
    )
    weigher = PoseWeigher(target, source, PoseMapper(sampled_surface(to), sampled_surface(of)))
    return [
        weigher.weigh(one.functional_map, one.evidence, chirality=chirality_of(one, options))
        for one in found
    ]


@lru_cache(maxsize=4 * MOST_SEARCHED)
def _prepared(
    options: SurfaceOptions, path: Origin, name: str, digest: str, cleaning: CleaningOptions
) -> SpectralShape:
    return prepare_surface(read_shape(path, cleaning, name=name, digest=digest), options)
