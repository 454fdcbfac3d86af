"""Jobs of maps of all vertices: surfaces in full, candidate maps of pairs, and one map refined where all agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from collalign.confidence.candidate_model import EVIDENCE, evidence_score
from collalign.engine.jobs.job import Job, Results, Wanted
from collalign.engine.store.records import Record, to_record
from collalign.nonrigid.map_evidence import MIXED_ORIENTATION
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.portfolio import is_same_map
from collalign.nonrigid.pose_maps import PoseMapper
from collalign.nonrigid.posed_surface import first_samples, sampled_surface
from collalign.nonrigid.refine import Refiner
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.evidence.candidates import PoseWeigher
from collalign.stages.evidence.map_surfaces import StoredSurface
from data_tools.arrays import FloatArray, Holds, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED


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
        for i, (name, path, digest) in enumerate(zip(shapes.names, shapes.files, shapes.digests, strict=True))
    }
    return session.compute(DETAILING, wanted, time_limit_s=session.run.shape_time_limit_s)


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
    target: Samples, source: Samples, surfaces: tuple[StoredSurface, StoredSurface], start: FloatArray
) -> CandidateMaps:
    """Return the maps that poses (m, 3, 3) of a pair lead to, weighed by all evidence; runs inside a worker."""
    to, of = (first_samples(surface.posed, NUM_SCREEN_POINTS, NUM_SCREEN_FUNCTIONS) for surface in surfaces)
    mapper = PoseMapper(to, of)
    weigher = PoseWeigher(target, source, mapper)
    found = []
    for pose in start:
        chirality = float(np.sign(np.linalg.det(pose)))
        plain = mapper.map_from(pose)
        for candidate in (plain, mapper.oriented(plain, preserving=chirality > 0)):
            _, _, evidence = weigher.weigh(candidate, mapper.evidence(candidate), chirality=chirality)
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
    return CandidateMaps(maps=np.stack([c for _, c in best]), log_odds=np.array([score for score, _ in best]))


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
