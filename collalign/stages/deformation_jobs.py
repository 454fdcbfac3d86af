"""Jobs of maps of all vertices: surfaces in full, candidate maps of pairs, and the place of every vertex."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from collalign.confidence.candidate_model import EVIDENCE, evidence_score
from collalign.engine.job import Job, Results, Wanted
from collalign.engine.records import Record, to_record
from collalign.nonrigid.functional_map import FunctionalMap, fitted_map, mutual_nearest_rows
from collalign.nonrigid.map_evidence import MIXED_ORIENTATION
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import (
    is_same_map,
    refined_with_evidence,
    trust_of,
    with_others_from_poses,
)
from collalign.nonrigid.pose_maps import PoseMapper, first_samples, sampled_surface
from collalign.nonrigid.refine import Refiner
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.registration.by_map import MapGoals, fitted_by_map
from collalign.stages.evidence.candidates import PoseWeigher
from collalign.stages.evidence.map_surfaces import StoredSurface
from collalign.stages.shape_stage import compute_surfaces
from data_tools.arrays import FloatArray, Holds, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class VertexSurface:
    """A surface at all its working vertices.

    Attributes
    ----------
    name : str
    basis : ndarray of float32, shape (w, m + 1)
        Functions at the working vertices, the constant one first.
    working_vertices : ndarray, shape (w, 3)
    working_faces : ndarray of int, shape (f, 3)
    to_working : ndarray of int, shape (v,)
        The working vertex of each vertex of the file, -1 for none.
    """

    name: str
    basis: Annotated[NDArray[np.float32], Holds(shape="w _")]
    working_vertices: Annotated[FloatArray, Holds(shape="w 3")]
    working_faces: Annotated[IntArray, Holds(shape="_ 3")]
    to_working: Annotated[IntArray, Holds(shape="_", lower=-1)]


def prepare_detailed(path: Origin, name: str, digest: str, options: SurfaceOptions) -> Record:
    """Read and prepare one surface, unless it has changed since its digest was taken; runs inside a worker.

    Returns
    -------
    dict
        The fields of :class:`collalign.stages.evidence.map_surfaces.StoredSurface` and of :class:`VertexSurface`.
    """
    shape = read_shape(path, AS_STORED, name=name, digest=digest)
    if not shape.is_mesh:
        raise InputError(f"{shape.file or shape.name}: maps of all vertices need a mesh")
    prepared = prepare_surface(shape, options)
    sampled = sampled_surface(prepared)
    at_vertices = VertexSurface(
        name=name,
        basis=prepared.basis.astype(np.float32),
        working_vertices=prepared.vertices,
        working_faces=prepared.faces.astype(np.int32),
        to_working=prepared.to_working.astype(np.int32),
    )
    return to_record(StoredSurface.of(sampled.spectral, sampled.normals)) | to_record(at_vertices)


#: Prepares a surface in full. The version changes whenever the same file would give another one.
DETAILING = Job(kind="surfaces", version="detailed-6", run=prepare_detailed, reader=StoredSurface)


def prepare_all_detailed(
    session: AlignSession, shapes: Shapes, options: SurfaceOptions
) -> Results[int, StoredSurface]:
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


#: Dense samples and eigenfunctions of candidate maps: few, so that one takes some 20 ms.
NUM_SCREEN_POINTS, NUM_SCREEN_FUNCTIONS = 400, 60
#: Candidates of each pair that the collection chooses from.
MAX_CANDIDATES = 3
#: Functions, the constant one included, that the full refinement starts with, and how fast they grow.
FIRST_SIZE, GROWTH = 30, 1.3


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateMaps:
    """``C_source_target`` of candidate maps, shape (m, k, k), the likeliest first, and their log-odds, shape (m,)."""

    maps: Annotated[FloatArray, Holds(shape="m k k")]
    log_odds: Annotated[FloatArray, Holds(shape="m")]


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedMap:
    """``C_source_target`` in all functions, shape (k, k)."""

    map: Annotated[FloatArray, Holds(shape="k k")]


def candidate_maps(
    target: Samples,
    source: Samples,
    surfaces: tuple[StoredSurface, StoredSurface],
    start: FloatArray,
) -> CandidateMaps:
    """Return the maps that poses (m, 3, 3) of a pair lead to, weighed by all evidence; runs inside a worker."""
    to, of = (
        first_samples(surface.posed, NUM_SCREEN_POINTS, NUM_SCREEN_FUNCTIONS)
        for surface in surfaces
    )
    mapper = PoseMapper(to, of)
    weigher = PoseWeigher(target, source, mapper)
    found = []
    for pose in start:
        chirality = float(np.sign(np.linalg.det(pose)))
        plain = mapper.map_from(pose)
        for candidate in (plain, mapper.oriented(plain, preserving=chirality > 0)):
            _, _, evidence = weigher.weigh(
                candidate, mapper.evidence(candidate), chirality=chirality
            )
            keeps_sides = not evidence[EVIDENCE.index("orientation")] < MIXED_ORIENTATION
            found.append((keeps_sides, evidence, candidate.C_source_target))
    # Maps that swap left and right are for pairs that have no others: most evidence says the same of both.
    able = [one for one in found if one[0]] or found
    scores = evidence_score(np.stack([evidence for _, evidence, _ in able])).tolist()
    kept: list[tuple[float, FloatArray]] = []
    for score, (_, _, c) in sorted(zip(scores, able, strict=True), key=lambda one: -one[0]):
        if not any(is_same_map(c, other) for _, other in kept):
            kept.append((score, c))
    best = kept[:MAX_CANDIDATES]
    return CandidateMaps(
        maps=np.stack([c for _, c in best]), log_odds=np.array([score for score, _ in best])
    )


def refine_map(surfaces: tuple[StoredSurface, StoredSurface], start: FloatArray) -> RefinedMap:
    """Return what a coarse ``C_source_target`` (q, q) leads to on all samples; runs inside a worker."""
    target, source = (surface.spectral for surface in surfaces)
    refiner = Refiner(target, source, first=FIRST_SIZE, factor=GROWTH)
    return RefinedMap(map=refiner.from_functional_map(start).C_source_target)


#: Map a pair. The version changes whenever the same surfaces and starts would give other maps.
CANDIDATES, REFINING = (
    Job(kind="evidence", version="consistent-6", run=candidate_maps, reader=CandidateMaps),
    Job(kind="evidence", version="consistent-7", run=refine_map, reader=RefinedMap),
)


#: Origin of the map that a collection asks for.
_CONSISTENT = "collection"


def places_on_reference(
    reference: VertexSurface,
    shape: VertexSurface,
    bases: FloatArray,
    samples: tuple[StoredSurface, StoredSurface],
    mirrored: bool,
) -> tuple[FloatArray, float, FloatArray]:
    """Return the places (v, 3) of a file's vertices, NaN for none, and the confidence of all and of each (v,).

    The functions say which vertices belong to each other as far as their number resolves; the reference is laid onto
    the shape by that, and each vertex belongs to the point of the laid surface that is closest to it.

    Parameters
    ----------
    reference, shape : VertexSurface
    bases : ndarray, shape (2, m, n)
        The common functions of each.
    samples : pair of StoredSurface
    mirrored : bool
        Whether one of the two is mirrored in the common frame.
    """
    to, of = _working_surface(reference), _working_surface(shape)
    if reference.name == shape.name:
        places, sure, sure_at = of.vertices, 1.0, np.ones(len(of.vertices))
    else:
        goals = _goals(of, *_vertex_maps(reference, shape, bases))
        moving = to.transformed(
            np.diag([1.0, 1.0, -1.0 if mirrored else 1.0, 1.0])
        )  # none turns inside out
        fitted = fitted_by_map(of, moving, goals)
        places = SurfaceLocator(fitted, to.faces).closest(of.vertices).on(to.vertices)
        sure, sure_at = trust_of_places(of, places, samples, mirrored=mirrored)
    every = np.column_stack([places, sure_at])
    every = np.where((shape.to_working >= 0)[:, None], every[shape.to_working], np.nan)
    return every[:, :3], sure, every[:, 3]


def trust_of_places(
    of: Shape, places: FloatArray, samples: tuple[StoredSurface, StoredSurface], *, mirrored: bool
) -> tuple[float, FloatArray]:
    """Return the confidence of places (w, 3) of all working vertices, and of each: theirs among maps from poses."""
    mapper = PoseMapper(samples[0].posed, (samples[1].mirrored if mirrored else samples[1]).posed)
    target, source = mapper.target.spectral, mapper.source.spectral
    placed = places[cKDTree(of.vertices).query(samples[1].vertices)[1]]
    forward, backward = (
        cKDTree(a).query(b)[1] for a, b in ((target.vertices, placed), (placed, target.vertices))
    )
    c = fitted_map(target.basis, source.basis, forward, backward)
    own = FunctionalMap(C_source_target=c, map_target_source=forward, map_source_target=backward)
    found = with_others_from_poses(
        mapper, refined_with_evidence(target, source, own, _CONSISTENT), NonrigidOptions()
    )
    sure, at_samples = trust_of(target, source, found)
    return sure, at_samples[cKDTree(samples[1].vertices).query(of.vertices)[1]]


def _working_surface(surface: VertexSurface) -> Shape:
    return Shape.from_arrays(surface.working_vertices, surface.working_faces, name=surface.name)


def _vertex_maps(
    reference: VertexSurface, shape: VertexSurface, bases: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return the reference's vertex nearest to each of the shape in the common functions, and the other way."""
    of_reference, of_shape = (
        np.asarray(surface.basis[:, : bases.shape[-1]], dtype=np.float64) @ basis
        for surface, basis in zip((reference, shape), bases, strict=True)
    )
    return mutual_nearest_rows(of_reference, of_shape)


def _goals(shape: Shape, to_reference: IntArray, from_reference: IntArray) -> MapGoals:
    """Return where both maps take the reference's vertices."""
    vertices = np.concatenate([np.arange(len(from_reference)), to_reference])
    return vertices, np.concatenate([shape.vertices[from_reference], shape.vertices])
