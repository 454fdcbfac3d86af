"""One map between two deformable surfaces, matched and compared with the truth; what pairs share is kept at hand."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.records import Record
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import find_candidates, screened_from_within
from collalign.nonrigid.spectral_shape import SpectralShape, prepare_surface
from collalign.tools.match.nonrigid import match_prepared
from data_tools.arrays import IntArray
from data_tools.embedding.sampling import farthest_points
from data_tools.surface.shape import Shape
from experiments.experiment import Cell
from experiments.maps.evaluation import MapErrors, MapEvaluator
from experiments.maps.map_sets import LANDMARKED, MapSet, read_map_set
from experiments.maps.paper_chain import PaperChain, dense_point_maps, in_files, match_by_paper

#: Points at which maps between registered meshes are evaluated.
NUM_EVALUATED = 200
#: Surfaces of ``--quick``: fewer functions and samples.
QUICK_SURFACE = {"num_functions": 36, "num_samples": 50, "num_dense": 150}
#: pyFM: eigenfunctions of a mesh; every so many of its descriptors, as in its example; landmarks, where it has some;
#: and steps of ZoomOut from its 50 functions on.
NUM_PROCESSED, DESCRIPTOR_STEP, NUM_LANDMARKS, ZOOMOUT_STEPS, ZOOMOUT_STEP = 128, 5, 5, 10, 5
#: A self-map is taken for the mirror image only if the landmarks confirm it this well.
MAX_MIRROR_ERROR = 0.05
#: Prepared shapes that are kept, about 20 MB each.
_NUM_KEPT = 80


@dataclass(frozen=True, kw_only=True, eq=False)
class Mirror:
    """The mirror image of each vertex of registered meshes, by the self-map that the landmarks confirm best.

    Attributes
    ----------
    image : ndarray of int, shape (v,)
    error : float
        Its mean error at the landmarks, in units of sqrt(area).
    """

    image: IntArray
    error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """A shape prepared for matching, and the CPU time that this took."""

    shape: Shape
    spectral: SpectralShape
    seconds: float


def measure_map(cell: Cell) -> Record:
    """Match one pair with one tool of :data:`TOOLS` and return its errors at the evaluated points."""
    settings = cell.settings
    maps = map_set(cell.data, settings["set"])
    mirror = mirror_of(cell.data, settings) if maps.data.vertices_correspond else None
    errors_of = error_measure(maps, settings, mirror)
    images, seconds = TOOLS[settings["tool"]](cell)
    errors = errors_of(images)
    return {
        "direct": errors.direct,
        "mirrored": errors.mirrored,
        "mirror_error": None if mirror is None else mirror.error,
        "seconds": seconds,
    }


def _toolkit(cell: Cell) -> tuple[IntArray, float]:
    """Match by default."""
    target, source = (
        prepared(cell.data, cell.settings, cell.settings[role]) for role in ("target", "source")
    )
    started = time.process_time()
    found = match_prepared(target.spectral, source.spectral)
    return (
        found.point_map_target_source,
        target.seconds + source.seconds + time.process_time() - started,
    )


def _paper(cell: Cell, *, is_fast: bool) -> tuple[IntArray, float]:
    """Match by the paper's chain."""
    target, source = (
        prepared(cell.data, cell.settings, cell.settings[role]) for role in ("target", "source")
    )
    started = time.process_time()
    found, _ = match_by_paper(target.spectral, source.spectral, PaperChain(is_fast=is_fast))
    return (
        found.point_map_target_source,
        target.seconds + source.seconds + time.process_time() - started,
    )


def _zoomout(cell: Cell, *, num_landmarks: int) -> tuple[IntArray, float]:
    """Fit a functional map to wave kernel signatures by pyFM, and refine it by its ZoomOut (Melzi et al. 2019)."""
    from pyFM.functional import FunctionalMapping

    maps = map_set(cell.data, cell.settings["set"])
    points = evaluated_points(maps, cell.settings["source"], cell.settings["points"])[
        :num_landmarks
    ]
    truth, _ = true_places(maps, cell.settings["target"], points, None)
    meshes = [
        _processed(cell.data, cell.settings["set"], cell.settings[role])
        for role in ("target", "source")
    ]
    started = time.process_time()
    model = FunctionalMapping(*(mesh for mesh, _ in meshes))
    landmarks = np.column_stack([truth, points]) if num_landmarks else None
    model.preprocess(landmarks=landmarks, subsample_step=DESCRIPTOR_STEP, k_process=NUM_PROCESSED)
    model.fit()
    refined = model.zoomout_refine(nit=ZOOMOUT_STEPS, step=ZOOMOUT_STEP)
    images = np.asarray(model.get_p2p(refined), dtype=np.int64)
    return images, sum(seconds for _, seconds in meshes) + time.process_time() - started


@functools.lru_cache(maxsize=_NUM_KEPT)
def _processed(data: Path, set_name: str, name: str) -> tuple[Any, float]:
    """Return pyFM's mesh with its eigenfunctions, and the CPU time that these took."""
    from pyFM.mesh import TriMesh

    shape = map_set(data, set_name).data.shape(name)
    started = time.process_time()
    mesh = TriMesh(np.array(shape.vertices), np.array(shape.faces)).process(k=NUM_PROCESSED)
    return mesh, time.process_time() - started


#: Each returns the vertex of the target for each vertex of the source, and the CPU time from the meshes on.
TOOLS: dict[str, Callable[[Cell], tuple[IntArray, float]]] = {
    "collalign": _toolkit,
    "the paper's chain": functools.partial(_paper, is_fast=False),
    "the paper's fast chain": functools.partial(_paper, is_fast=True),
    "pyFM, ZoomOut": functools.partial(_zoomout, num_landmarks=0),
    f"pyFM, ZoomOut, {NUM_LANDMARKS} landmarks": functools.partial(
        _zoomout, num_landmarks=NUM_LANDMARKS
    ),
}


def errors_of(record: Record) -> MapErrors:
    """Return the errors that a record of :func:`measure_map` holds."""
    return MapErrors(direct=record["direct"], mirrored=record["mirrored"])


def error_measure(
    maps: MapSet, settings: Mapping[str, Any], mirror: Mirror | None
) -> Callable[[IntArray], MapErrors]:
    """Return what gives the errors of any map, from the vertex of the target for each vertex of the source.

    Parameters
    ----------
    maps : MapSet
    settings : mapping
        With ``target``, ``source``, and the number of ``points`` on registered meshes.
    mirror : Mirror or None
        On registered meshes; elsewhere the landmarks' mirror images are used.
    """
    points = evaluated_points(maps, settings["source"], settings["points"])
    truth, mirrored = true_places(maps, settings["target"], points, mirror)
    evaluator = MapEvaluator(maps.data.shape(settings["target"]), truth, mirrored)
    return lambda images: evaluator.errors(images[points])


def evaluated_points(maps: MapSet, source: str, num: int) -> IntArray:
    """Return the vertices of the source at which its maps are evaluated: landmarks, or farthest points."""
    if maps.name in LANDMARKED:
        return maps.landmarks(source)
    return farthest_points(maps.data.shape(source), num, metric="euclidean")


def true_places(
    maps: MapSet, target: str, points: IntArray, mirror: Mirror | None
) -> tuple[IntArray, IntArray | None]:
    """Return the vertices of the target at which the first evaluated points belong, and of their mirror images."""
    if maps.name in LANDMARKED:
        marks = maps.landmarks(target)[: len(points)]
        whole = maps.data.mirror is not None and len(marks) == len(maps.data.mirror)
        return marks, marks[maps.data.mirror] if whole else None
    return points, None if mirror is None else mirror.image[points]


def prepared(data: Path, settings: Mapping[str, Any], name: str) -> Prepared:
    """Return a prepared shape; the last ones are kept in memory.

    Parameters
    ----------
    data : Path
        Folder of the public collections.
    settings : mapping
        With ``set`` and the ``surface`` options.
    name : str
    """
    return _prepared(data, settings["set"], name, json.dumps(settings["surface"], sort_keys=True))


def mirror_of(data: Path, settings: Mapping[str, Any]) -> Mirror | None:
    """Return the mirror images of the vertices of registered meshes, where landmarks confirm a self-map."""
    return _mirror(data, settings["set"], json.dumps(settings["surface"], sort_keys=True))


@functools.lru_cache(maxsize=4)
def map_set(data: Path, name: str) -> MapSet:
    """Return a benchmark; the last ones are kept in memory."""
    return read_map_set(data, name)


@functools.lru_cache(maxsize=_NUM_KEPT)
def _prepared(data: Path, set_name: str, name: str, surface: str) -> Prepared:
    shape = map_set(data, set_name).data.shape(name)
    started = time.process_time()
    spectral = prepare_surface(shape, SurfaceOptions(**json.loads(surface)))
    return Prepared(shape=shape, spectral=spectral, seconds=time.process_time() - started)


@functools.lru_cache(maxsize=4)
def _mirror(data: Path, set_name: str, surface: str) -> Mirror | None:
    maps = map_set(data, set_name)
    if maps.data.mirror is None or maps.data.landmark_vertices is None:
        return None
    name = maps.data.names[0]
    shape = _prepared(data, set_name, name, surface).spectral
    marks = maps.landmarks(name)
    evaluator = MapEvaluator(maps.data.shape(name), marks[maps.data.mirror])
    found, options = [], NonrigidOptions(orientation="any")
    within = screened_from_within(shape, shape, options)
    for self_map in find_candidates(shape, shape, within, options):
        c = self_map.functional_map.C_source_target
        image = in_files(dense_point_maps(shape, shape, c)[0], shape, shape)
        found.append(Mirror(image=image, error=float(evaluator.errors(image[marks]).direct.mean())))
    best = min(found, key=lambda mirror: mirror.error, default=None)
    return None if best is None or best.error > MAX_MIRROR_ERROR else best
