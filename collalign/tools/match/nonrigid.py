"""Non-rigid matching of two shapes, from files to a map of all vertices; reads like section 6.1 of the paper."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from collalign.confidence.map_model import map_confidence
from collalign.nonrigid.map_evidence import MIXED_ORIENTATION
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import FROM_POSES, Refined, find_candidates, full_harmonic
from collalign.nonrigid.refine import between_files
from collalign.nonrigid.surface.spectral_shape import SpectralShape
from collalign.tools.match.prepare import prepare_file
from collalign.tools.match.result import NonrigidCandidate, NonrigidMatch
from data_tools.arrays import IntArray, read_only
from data_tools.checks import as_options
from data_tools.errors import InputError
from data_tools.io.objects import ShapeLike, as_origin
from data_tools.rotations import nearest_orthogonal
from data_tools.threads import one_blas_thread

#: A map that keeps left and right may be this much behind the best one.
ORIENTATION_MARGIN = 1.0
#: Eigenfunctions in which the energies of candidates are compared.
ENERGY_DIM = 30


@one_blas_thread()
def match_shapes(
    target: ShapeLike,
    source: ShapeLike,
    *,
    options: NonrigidOptions | Mapping[str, Any] | None = None,
    surface_options: SurfaceOptions | Mapping[str, Any] | None = None,
    **keywords: Any,
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
    asked = as_options("options", options, NonrigidOptions, keywords)
    surface = as_options("surface_options", surface_options, SurfaceOptions)
    started = time.perf_counter()
    to = prepare_file(as_origin(target, "target"), surface)
    of = prepare_file(as_origin(source, "source"), surface)
    prepared = time.perf_counter() - started
    return match_prepared(to, of, asked, prepared_s=prepared)


@one_blas_thread()
def match_prepared(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions | None = None, *, prepared_s: float = 0.0
) -> NonrigidMatch:
    """Match two prepared shapes; see :func:`match_shapes`.

    Parameters
    ----------
    target, source : SpectralShape
        Of the same number of functions and samples.
    options : NonrigidOptions, optional
    prepared_s : float
        Seconds that preparation took, for the record.
    """
    options = options or NonrigidOptions()
    _check_fit(target, source)
    started = time.perf_counter()
    found = chosen_first(find_candidates(target, source, options), options)
    searched = time.perf_counter()
    maps = full_harmonic(target, source).of_all_vertices(found[0].functional_map)
    finished = time.perf_counter()
    times_s = {"prepare": prepared_s, "candidates": searched - started, "vertices": finished - searched}
    kept = found[: options.num_candidates]
    return match_of(target, source, kept, maps, confidence=confidence(found, options), times_s=times_s)


def match_of(
    target: SpectralShape,
    source: SpectralShape,
    found: list[Refined],
    maps: tuple[IntArray, IntArray],
    *,
    confidence: float,
    times_s: dict[str, float] | None = None,
) -> NonrigidMatch:
    """Return candidates, the chosen one first, and its maps of all working vertices both ways as a match of files."""
    forward, backward = maps
    return NonrigidMatch(
        target_name=target.name,
        source_name=source.name,
        point_map_target_source=read_only(between_files(forward, target.to_original, source.to_working)),
        point_map_source_target=read_only(between_files(backward, source.to_original, target.to_working)),
        functional_map=read_only(found[0].functional_map.C_source_target),
        candidates=tuple(_public(target, source, candidate) for candidate in found),
        dense_source=read_only(source.to_original[source.dense]),
        confidence=confidence,
        times_s=times_s or {},
        notes=tuple(f"{s.name}: {note}" for s in (target, source) for note in s.notes),
    )


def chosen_first(found: list[Refined], options: NonrigidOptions) -> list[Refined]:
    """Return candidates with the chosen one first, then by score.

    It is the best one that keeps left and right, where normals tell, unless its evidence is far behind: a mirror
    image scores like the true map, so the difference means that no true map was found.
    """
    ordered = sorted(found, key=lambda c: c.score)
    if options.orientation == "any":
        return ordered
    near = [c for c in ordered if c.score <= ordered[0].score + ORIENTATION_MARGIN]
    chosen = next((c for c in near if not c.evidence.orientation < MIXED_ORIENTATION), ordered[0])
    return [chosen, *(c for c in ordered if c is not chosen)]


def confidence(found: list[Refined], options: NonrigidOptions) -> float:
    """Return how far the chosen candidate can be trusted.

    Rivals are candidates of its orientation; its mirror image is none where normals tell the two apart.
    """
    chosen = found[0]
    rivals = [c.score for c in found[1:] if options.orientation == "any" or _same_orientation(c, chosen)]
    return map_confidence(chosen.evidence, chosen.score, rivals, from_poses=chosen.origin == FROM_POSES)


def _same_orientation(candidate: Refined, chosen: Refined) -> bool:
    first, second = candidate.evidence.orientation, chosen.evidence.orientation
    return not (np.isfinite(first) and np.isfinite(second)) or first * second > 0


def _public(target: SpectralShape, source: SpectralShape, candidate: Refined) -> NonrigidCandidate:
    forward = candidate.functional_map.map_target_source
    images = target.functions[target.dense[forward], :ENERGY_DIM]
    own = source.functions[source.dense[: len(forward)], :ENERGY_DIM]
    residuals = own @ nearest_orthogonal(images.T @ own).T - images
    return NonrigidCandidate(
        functional_map=read_only(candidate.functional_map.C_source_target),
        map_target_source=read_only(target.to_original[target.dense[forward]]),
        energy=float((residuals**2).mean()),
        evidence=candidate.evidence,
        origin=candidate.origin,
    )


def _check_fit(target: SpectralShape, source: SpectralShape) -> None:
    if len(target.eigenvalues) != len(source.eigenvalues):
        raise InputError(
            f"{target.name} has {len(target.eigenvalues)} eigenfunctions, {source.name} {len(source.eigenvalues)}: "
            "prepare both with the same options"
        )
