"""Non-rigid matching of two shapes, from files to a map of all vertices; reads like section 6.1 of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Unpack

import numpy as np

from collalign.nonrigid.functional_map import HarmonicRefiner
from collalign.nonrigid.map_options import NonrigidKeywords, NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import (
    Refined,
    agreements,
    find_candidates,
    has_normals,
    mended,
    sharpened,
    trust_of,
)
from collalign.nonrigid.refine import between_files
from collalign.nonrigid.spectral_shape import SpectralShape, prepare_surface
from collalign.registration.by_map import fitted_by_map
from collalign.tools.match.result import NonrigidCandidate, NonrigidMatch
from data_tools.arrays import IntArray, read_only
from data_tools.checks import as_options
from data_tools.errors import InputError
from data_tools.io.objects import ShapeLike, as_origin
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED
from data_tools.threads import one_blas_thread

#: Weight of the orientation, at most 1, relative to the logarithm of the agreement. On 49 pairs of eight kinds, each
#: kind judged by the weight that is best on the others, chosen maps err .085; .087 without it, .109 if maps that mix
#: left and right (:data:`collalign.nonrigid.map_evidence.MIXED_ORIENTATION`) are out of the question.
ORIENTATION_WEIGHT = 0.4


@one_blas_thread()
def match_shapes(
    target: ShapeLike,
    source: ShapeLike,
    *,
    options: NonrigidOptions | Mapping[str, Any] | None = None,
    surface_options: SurfaceOptions | Mapping[str, Any] | None = None,
    **keywords: Unpack[NonrigidKeywords],
) -> NonrigidMatch:
    """Match two deformable shapes: one target vertex for each source vertex.

    Parameters
    ----------
    target, source : file, array (n, 3), pair (V, F), or trimesh or Open3D object
        Vertex indices are those of the shapes as given. Rigid poses: :func:`collalign.match_rigid`.
    options : NonrigidOptions or mapping, optional
    surface_options : SurfaceOptions or mapping, optional
    **keywords
        Fields of ``options`` by themselves, which win.

    Returns
    -------
    NonrigidMatch

    Raises
    ------
    InputError
        If a shape cannot be read or is too small for the functions asked for.

    Examples
    --------
    >>> from data_tools.datasets.synthetic_shapes import figure
    >>> body = figure(resolution=1)
    >>> small = collalign.SurfaceOptions(num_functions=30, num_dense=100)
    >>> found = collalign.match_shapes(body, body, surface_options=small)
    >>> len(found.point_map_target_source) == len(body.vertices)
    True
    >>> figure = found.plot(body, body)
    """
    wanted = as_options("options", options, NonrigidOptions, keywords)
    surface = as_options("surface_options", surface_options, SurfaceOptions)
    to, of = (
        prepare_file(as_origin(file, role), surface)
        for file, role in ((target, "target"), (source, "source"))
    )
    return match_prepared(to, of, wanted)


def prepare_file(file: Origin | str, options: SurfaceOptions | None = None) -> SpectralShape:
    """Read and prepare a file: any mesh or point cloud that :func:`data_tools.io.shapes.read_shape` reads."""
    return prepare_surface(read_shape(file, AS_STORED), options)


@one_blas_thread()
def match_prepared(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions | None = None
) -> NonrigidMatch:
    """Match two prepared shapes; see :func:`match_shapes`.

    Parameters
    ----------
    target, source : SpectralShape
        Of the same number of functions and samples.
    options : NonrigidOptions, optional
    """
    options = options or NonrigidOptions()
    if len(target.eigenvalues) != len(source.eigenvalues):
        raise InputError(
            f"{target.name} has {len(target.eigenvalues)} eigenfunctions, {source.name} {len(source.eigenvalues)}: "
            "prepare both with the same options"
        )
    found = finished(target, source, options)
    maps = vertex_maps(target, source, found[0])
    return match_of(target, source, found, maps, num_candidates=options.num_candidates)


def finished(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> list[Refined]:
    """Return all candidates, the chosen one first, and that one mended and sharpened."""
    chosen, *others = chosen_first(target, find_candidates(target, source, options), options)
    return [sharpened(target, source, mended(target, source, chosen, options)), *others]


def vertex_maps(
    target: SpectralShape, source: SpectralShape, chosen: Refined
) -> tuple[IntArray, IntArray]:
    """Return the maps of the files' vertices, source to target (v,) and back (u,), that a map of samples leads to.

    The target is laid onto the source by that map, as rigidly as it allows, and then by closest points with normals
    (:func:`collalign.registration.by_map.fitted_by_map`); clouds by their functions alone.
    """
    found, at_target, at_source = chosen.functional_map, target.dense, source.dense
    if not has_normals(target, source):
        return between_files(
            source.vertices[HarmonicRefiner(target, source).of_all_vertices(found)[1]],
            target,
            source,
        )
    chirality = -1.0 if chosen.evidence.orientation < 0 else 1.0
    moving = target.working_shape.transformed(np.diag([1.0, 1.0, chirality, 1.0]))
    to = np.concatenate([at_source[found.map_source_target], at_source])
    goals = np.concatenate([at_target, at_target[found.map_target_source]]), source.vertices[to]
    return between_files(fitted_by_map(source.working_shape, moving, goals), target, source)


def match_of(
    target: SpectralShape,
    source: SpectralShape,
    found: list[Refined],
    maps: tuple[IntArray, IntArray],
    *,
    num_candidates: int,
) -> NonrigidMatch:
    """Return candidates, the chosen one first, and its maps of the files' vertices, (v,) each, as a match."""
    forward, backward = maps
    confidence, at_vertices = trust_of(target, source, found)
    return NonrigidMatch(
        target_name=target.name,
        source_name=source.name,
        point_map_target_source=read_only(forward),
        point_map_source_target=read_only(backward),
        functional_map=read_only(found[0].functional_map.C_source_target),
        candidates=tuple(_public(target, candidate) for candidate in found[:num_candidates]),
        dense_source=read_only(source.to_original[source.dense]),
        confidence=confidence,
        vertex_confidence=read_only(
            np.where(source.to_working >= 0, at_vertices[source.to_working], np.nan)
        ),
        notes=tuple(
            replace(note, shapes=(s.name, *note.shapes))
            for s in (target, source)
            for note in s.notes
        ),
    )


def chosen_first(
    target: SpectralShape, found: list[Refined], options: NonrigidOptions
) -> list[Refined]:
    """Return candidates with the chosen one first, then by score.

    It is the one that the others agree with most and that keeps left and right most clearly, where normals tell.
    """
    ordered = sorted(found, key=lambda c: c.score)
    sides = np.nan_to_num([c.evidence.orientation for c in ordered])
    if options.orientation == "any":
        sides = np.abs(sides)
    support = np.log(agreements(target, ordered)) + ORIENTATION_WEIGHT * sides
    chosen = ordered[
        int(np.argmax(np.where((sides >= 0.0) | (sides < 0.0).all(), support, -np.inf)))
    ]
    return [chosen, *(c for c in ordered if c is not chosen)]


def _public(target: SpectralShape, candidate: Refined) -> NonrigidCandidate:
    forward = candidate.functional_map.map_target_source
    return NonrigidCandidate(
        functional_map=read_only(candidate.functional_map.C_source_target),
        map_target_source=read_only(target.to_original[target.dense[forward]]),
        evidence=candidate.evidence,
        origin=candidate.origin,
    )
