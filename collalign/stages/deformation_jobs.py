"""Jobs of maps of all vertices: surfaces in full, candidate maps of pairs, and the place of every vertex."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy

from collalign.engine.job import Job, Results, Wanted
from collalign.engine.records import Record, to_record
from collalign.nonrigid.functional_map import FunctionalMap, fitted_map, mutual_nearest_rows
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import (
    agreements,
    find_candidates,
    refined_with_evidence,
    screened_from_within,
    support,
    trust_of,
    with_others_from_poses,
)
from collalign.nonrigid.pose_maps import PoseMapper, sampled_surface
from collalign.nonrigid.refine import Refiner
from collalign.nonrigid.spectral_shape import SpectralShape, prepare_surface
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.registration.by_map import MapGoals, fitted_by_map
from collalign.stages.shape_stage import compute_surfaces
from data_tools.arrays import FloatArray, Holds, IntArray
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED
from data_tools.surface.closest import SurfaceLocator


def prepare_detailed(path: Origin, name: str, digest: str, options: SurfaceOptions) -> Record:
    """Read and prepare one surface, unless it has changed since its digest was taken; runs inside a worker.

    Returns
    -------
    dict
        The fields of :class:`collalign.nonrigid.spectral_shape.SpectralShape`, large ones in single precision.
    """
    shape = read_shape(path, AS_STORED, name=name, digest=digest)
    if not shape.is_mesh:
        raise InputError(f"{shape.file or shape.name}: maps of all vertices need a mesh")
    prepared = prepare_surface(shape, options)
    large = {"functions": prepared.functions, "waves": prepared.waves}
    return to_record(prepared) | {name: one.astype(np.float32) for name, one in large.items()}


#: Prepares a surface in full. The version changes whenever the same file would give another one.
DETAILING = Job(kind="surfaces", version="detailed-7", run=prepare_detailed, reader=SpectralShape)


def prepare_all_detailed(
    session: AlignSession, shapes: Shapes, options: SurfaceOptions
) -> Results[int, SpectralShape]:
    """Prepare the surfaces that the store lacks, and return them by position of the shape."""
    wanted = {
        i: Wanted(
            key=DETAILING.key({"options": options, "name": name}, digest),
            label=name,
            arguments={"path": path, "name": name, "digest": digest, "options": options},
        )
        for i, (name, path, digest) in enumerate(
            zip(shapes.names, shapes.files, shapes.digests, strict=True)
        )
    }
    return compute_surfaces(DETAILING, session, shapes, wanted)


#: Dense samples and eigenfunctions of candidate maps: few, so that a pair takes .6 to 1.5 s.
NUM_FEW_SAMPLES, NUM_FEW_FUNCTIONS = 400, 60
#: Functions, the constant one included, that the full refinement starts with, how fast they grow, and the weight of a
#: curvature there. Twenty bodies of SCAPE err 9 % less than with 1.3 and .3.
FIRST_SIZE, GROWTH, CURVATURE_WEIGHT = 30, 1.15, 0.6


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateMaps:
    """``C_source_target`` of candidate maps, shape (m, k, k), and their log-odds, shape (m,)."""

    maps: Annotated[FloatArray, Holds(shape="m k k")]
    log_odds: Annotated[FloatArray, Holds(shape="m")]


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedMap:
    """``C_source_target`` in all functions, shape (k, k)."""

    map: Annotated[FloatArray, Holds(shape="k k")]


def candidate_maps(surfaces: tuple[SpectralShape, SpectralShape], mirrored: bool) -> CandidateMaps:
    """Return all maps of a pair, whose source may have to be mirrored; runs inside a worker."""
    target, source = (one.coarse(NUM_FEW_SAMPLES, NUM_FEW_FUNCTIONS) for one in surfaces)
    source, options = source.mirrored if mirrored else source, NonrigidOptions()
    within = screened_from_within(target, source, options)
    found = find_candidates(target, source, within, options)
    sides = np.array([one.evidence.orientation for one in found])
    log_odds = support(agreements(target, found), sides)
    able = np.flatnonzero(np.isfinite(log_odds))
    maps = [found[i].functional_map.C_source_target for i in able]
    return CandidateMaps(maps=np.stack(maps), log_odds=log_odds[able])


def refine_map(surfaces: tuple[SpectralShape, SpectralShape], start: FloatArray) -> RefinedMap:
    """Return what a coarse ``C_source_target`` (q, q) leads to on all samples; runs inside a worker."""
    refiner = Refiner(*surfaces, first=FIRST_SIZE, factor=GROWTH, curvature_weight=CURVATURE_WEIGHT)
    return RefinedMap(map=refiner.from_functional_map(start).C_source_target)


#: Map a pair. The version changes whenever the same surfaces and starts would give other maps.
CANDIDATES, REFINING = (
    Job(kind="evidence", version="consistent-10", run=candidate_maps, reader=CandidateMaps),
    Job(kind="evidence", version="consistent-10", run=refine_map, reader=RefinedMap),
)


#: Origin of the map that a collection asks for.
_CONSISTENT = "collection"


def places_on_reference(
    surfaces: tuple[SpectralShape, SpectralShape], bases: FloatArray, mirrored: bool
) -> tuple[FloatArray, float, FloatArray]:
    """Return the places (v, 3) of a file's vertices, NaN for none, and the confidence of all and of each (v,).

    The functions say which vertices belong to each other as far as their number resolves; the reference is laid onto
    the shape by that, and each vertex belongs to the point of the laid surface that is closest to it.

    Parameters
    ----------
    surfaces : pair of SpectralShape
        The reference, and the shape.
    bases : ndarray, shape (2, m, n)
        The common functions of each.
    mirrored : bool
        Whether one of the two is mirrored in the common frame.
    """
    reference, shape = surfaces
    if reference.name == shape.name:
        places, sure, sure_at = shape.vertices, 1.0, np.ones(len(shape.vertices))
    else:
        goals = _goals(shape, *_vertex_maps(reference, shape, bases))
        moving = (reference.mirrored if mirrored else reference).working_shape
        fitted = fitted_by_map(shape.working_shape, moving, goals)
        locator = SurfaceLocator(fitted, reference.faces)
        places = locator.closest(shape.vertices).on(reference.vertices)
        sure, sure_at = trust_of_places(
            reference, shape.mirrored if mirrored else shape, places[shape.dense]
        )
    every = np.column_stack([places, sure_at])
    every = np.where((shape.to_working >= 0)[:, None], every[shape.to_working], np.nan)
    return every[:, :3], sure, every[:, 3]


def trust_of_places(
    target: SpectralShape, source: SpectralShape, places: FloatArray
) -> tuple[float, FloatArray]:
    """Return the confidence of a map, and that of each working vertex of the source.

    The map takes the source's dense samples to places (s, 3), and is a candidate beside those from poses.
    """
    mapper = PoseMapper(sampled_surface(target), sampled_surface(source))
    to, of = mapper.target.spectral, mapper.source.spectral
    forward, backward = (
        scipy.spatial.cKDTree(a).query(b)[1]
        for a, b in ((to.vertices, places), (places, to.vertices))
    )
    c = fitted_map(to.basis, of.basis, forward, backward)
    own = FunctionalMap(C_source_target=c, map_target_source=forward, map_source_target=backward)
    found = with_others_from_poses(
        mapper, refined_with_evidence(to, of, own, _CONSISTENT), NonrigidOptions()
    )
    sure, at_samples = trust_of(to, of, found)
    return sure, at_samples[source.nearest_dense]


def _vertex_maps(
    reference: SpectralShape, shape: SpectralShape, bases: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return the reference's vertex nearest to each of the shape in the common functions, and the other way."""
    return mutual_nearest_rows(
        *(
            surface.basis[:, : bases.shape[-1]] @ basis
            for surface, basis in zip((reference, shape), bases, strict=True)
        )
    )


def _goals(shape: SpectralShape, to_reference: IntArray, from_reference: IntArray) -> MapGoals:
    """Return where both maps take the reference's vertices."""
    vertices = np.concatenate([np.arange(len(from_reference)), to_reference])
    return vertices, np.concatenate([shape.vertices[from_reference], shape.vertices])
