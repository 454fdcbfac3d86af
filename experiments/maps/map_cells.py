"""One map between two deformable surfaces, matched and compared with the truth; what pairs share is kept at hand."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collalign.engine.store.records import Record
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import find_candidates
from collalign.nonrigid.surface.spectral_shape import SpectralShape, prepare_surface
from collalign.tools.match.nonrigid import match_prepared
from collalign.tools.match.result import NonrigidMatch
from data_tools.arrays import IntArray
from data_tools.embedding.sampling import farthest_points
from experiments.experiment import Cell
from experiments.maps.evaluation import MapErrors, MapEvaluator
from experiments.maps.graph_operator import graph_spectrum_of
from experiments.maps.map_sets import LANDMARKED, Copy, MapSet, read_map_set, vary
from experiments.maps.paper_chain import PAPER_SHARE, PaperChain, dense_point_maps, in_files, match_by_paper
from pairwise.status import Status

#: Points at which maps between registered meshes are evaluated.
NUM_EVALUATED = 200
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
    """A variant of a shape prepared for matching, and the processor time that this took."""

    copy: Copy
    spectral: SpectralShape
    seconds: float


def measure_map(cell: Cell) -> Record:
    """Match one pair and return its errors at the evaluated points."""
    settings = cell.settings
    maps = map_set(cell.data, settings["set"])
    shapes = [prepared(cell.data, settings, settings[role]) for role in ("target", "source")]
    started = time.process_time()
    match, status = _matched(shapes[0].spectral, shapes[1].spectral, settings["options"])
    seconds = time.process_time() - started
    mirror = mirror_of(cell.data, settings) if maps.data.vertices_correspond else None
    judge = judge_of(maps, settings, (shapes[0].copy, shapes[1].copy), mirror)
    errors = judge(match.point_map_target_source)
    return {
        "direct": errors.direct,
        "mirrored": errors.mirrored,
        "mirror_error": None if mirror is None else mirror.error,
        "confidence": match.confidence,
        "orientation": match.orientation,
        "origin": match.candidates[0].origin,
        "status": status.name,
        "seconds": seconds,
        "prepare_s": [shape.seconds for shape in shapes],
    }


def _matched(
    target: SpectralShape, source: SpectralShape, options: Mapping[str, Any]
) -> tuple[NonrigidMatch, Status]:
    """Match by default, or by the paper's chain where the options name its strategy."""
    if "strategy" not in options:
        return match_prepared(target, source), Status.CONVERGED
    chain = PaperChain(is_fast=options["strategy"] == "fast", share=options.get("mask_share", PAPER_SHARE))
    return match_by_paper(target, source, chain)


def errors_of(record: Record) -> MapErrors:
    """Return the errors that a record of :func:`measure_map` holds."""
    return MapErrors(direct=record["direct"], mirrored=record["mirrored"])


def judge_of(
    maps: MapSet, settings: Mapping[str, Any], copies: tuple[Copy, Copy], mirror: Mirror | None
) -> Callable[[IntArray], MapErrors]:
    """Return what gives the errors of any map between two copies, at points of the originals.

    It takes the vertex of the target's copy for each vertex of the source's copy.

    Parameters
    ----------
    maps : MapSet
    settings : mapping
        With ``target``, ``source``, and the number of ``points`` on registered meshes.
    copies : pair of Copy
        Of target and source.
    mirror : Mirror or None
        On registered meshes; elsewhere the landmarks' mirror images are used.
    """
    points = evaluated_points(maps, settings["source"], settings["points"])
    truth, mirrored = true_places(maps, settings["target"], points, mirror)
    target, source = copies
    present = (source.from_original[points] >= 0) & (target.from_original[truth] >= 0)
    if mirrored is not None:
        present &= target.from_original[mirrored] >= 0
        mirrored = target.from_original[mirrored[present]]
    evaluator = MapEvaluator(target.shape, target.from_original[truth[present]], mirrored)
    at = source.from_original[points[present]]
    return lambda images: evaluator.errors(images[at])


def evaluated_points(maps: MapSet, source: str, num: int) -> IntArray:
    """Return the vertices of the source at which its maps are evaluated: landmarks, or farthest points."""
    if maps.name in LANDMARKED:
        return maps.landmarks(source)
    return farthest_points(maps.data.shape(source), num, metric="euclidean")


def true_places(
    maps: MapSet, target: str, points: IntArray, mirror: Mirror | None
) -> tuple[IntArray, IntArray | None]:
    """Return the vertices of the target at which the evaluated points belong, and those of their mirror images."""
    if maps.name in LANDMARKED:
        marks = maps.landmarks(target)
        return marks, None if maps.data.mirror is None else marks[maps.data.mirror]
    return points, None if mirror is None else mirror.image[points]


def prepared(data: Path, settings: Mapping[str, Any], name: str) -> Prepared:
    """Return a prepared shape; the last ones are kept in memory.

    Parameters
    ----------
    data : Path
        Folder of the public collections.
    settings : mapping
        With ``set``, ``variant`` and the ``surface`` options.
    name : str
    """
    return _prepared(
        data, settings["set"], settings["variant"], name, json.dumps(settings["surface"], sort_keys=True)
    )


def mirror_of(data: Path, settings: Mapping[str, Any]) -> Mirror | None:
    """Return the mirror images of the vertices of registered meshes, where landmarks confirm a self-map."""
    return _mirror(data, settings["set"], json.dumps(settings["surface"], sort_keys=True))


@functools.lru_cache(maxsize=4)
def map_set(data: Path, name: str) -> MapSet:
    """Return a benchmark; the last ones are kept in memory."""
    return read_map_set(data, name)


@functools.lru_cache(maxsize=_NUM_KEPT)
def _prepared(data: Path, set_name: str, variant: str, name: str, surface: str) -> Prepared:
    copy = vary(map_set(data, set_name), name, variant)
    started = time.process_time()
    options = json.loads(surface)
    spectrum_of = graph_spectrum_of if options.pop("operator", "auto") == "graph" else None
    spectral = prepare_surface(copy.shape, SurfaceOptions(**options), spectrum_of=spectrum_of)
    return Prepared(copy=copy, spectral=spectral, seconds=time.process_time() - started)


@functools.lru_cache(maxsize=4)
def _mirror(data: Path, set_name: str, surface: str) -> Mirror | None:
    maps = map_set(data, set_name)
    if maps.data.mirror is None or maps.data.landmark_vertices is None:
        return None
    name = maps.data.names[0]
    shape = _prepared(data, set_name, "original", name, surface).spectral
    marks = maps.landmarks(name)
    evaluator = MapEvaluator(maps.data.shape(name), marks[maps.data.mirror])
    found = []
    for self_map in find_candidates(shape, shape, NonrigidOptions(orientation="any")):
        c = self_map.functional_map.C_source_target
        image = in_files(dense_point_maps(shape, shape, c)[0], shape, shape)
        found.append(Mirror(image=image, error=float(evaluator.errors(image[marks]).direct.mean())))
    best = min(found, key=lambda mirror: mirror.error, default=None)
    return None if best is None or best.error > MAX_MIRROR_ERROR else best
