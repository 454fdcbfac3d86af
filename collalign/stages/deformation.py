"""From poses and pairs to consistent maps of all vertices, step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import networkx as nx
import numpy as np

from collalign.engine.job import Job, Results, T, Wanted
from collalign.nonrigid.common_bases import choose_maps, common_bases
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.spectral_shape import SpectralShape
from collalign.options import AlignSession
from collalign.products.consistent_maps import VertexMaps
from collalign.products.pair import AlignedPair
from collalign.products.shapes import Shapes
from collalign.stages.deformation_jobs import (
    CANDIDATES,
    FIRST_SIZE,
    REFINING,
    places_on_reference,
    prepare_all_detailed,
)
from collalign.stages.poses.refinement import local_pairs
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.notes import Note

#: Triangles of a surface, at most: places of vertices are as exact as these.
MAX_FACES = 50_000
_SMALLEST = float(np.finfo(float).tiny)


def map_vertices(
    session: AlignSession, shapes: Shapes, pairs: Sequence[AlignedPair], rotations: FloatArray
) -> VertexMaps | None:
    """Map all vertices between all shapes that the pairs connect, consistently; None where fewer than two are.

    Similar shapes are mapped pair by pair, whatever their poses. One candidate of each pair is chosen by its evidence
    and by agreement around cycles; a common basis of functions (consistent latent basis) is fitted, the pairs' maps
    are refined from there by ZoomOut in all functions, as in Consistent ZoomOut (Huang, Ren, Wonka, Ovsjanikov 2020),
    and the basis that these agree with takes one shape, the reference, to all others, on which it is fitted: every
    vertex belongs where it lies on the fitted reference.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    pairs : sequence of AlignedPair
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    """
    surfaces = prepare_all_detailed(session, shapes, SurfaceOptions(max_faces=MAX_FACES))
    able = [
        pair
        for pair in pairs
        if pair.inlier and pair.target in surfaces and pair.source in surfaces
    ]
    members, chosen = _linked(_similar(len(shapes.names), able))
    if not chosen:
        return None
    tried = {_ends(pair): {"mirrored": _are_mirrored(rotations, *_ends(pair))} for pair in chosen}
    found = _of_pairs(CANDIDATES, session, shapes, surfaces, tried)
    members, chosen = _linked([pair for pair in chosen if _ends(pair) in found])
    if not chosen:
        return None
    candidates = [found[_ends(pair)] for pair in chosen]
    _, bases, residuals = choose_maps(
        _edges(members, chosen),
        [one.maps for one in candidates],
        [one.log_odds for one in candidates],
        len(members),
    )
    trust = dict(zip(map(_ends, chosen), 1.0 / np.maximum(residuals, _SMALLEST), strict=True))
    size = min(FIRST_SIZE, bases.shape[-1])
    requests = {
        _ends(pair): {
            "start": np.ascontiguousarray((bases[source] @ bases[target].T)[:size, :size])
        }
        for pair, (target, source) in zip(chosen, _edges(members, chosen).tolist(), strict=True)
    }
    refined = _of_pairs(REFINING, session, shapes, surfaces, requests)
    members, chosen = _linked([pair for pair in chosen if _ends(pair) in refined])
    if not chosen:
        return None
    edges, ends = _edges(members, chosen), [_ends(pair) for pair in chosen]
    maps = np.stack([refined[end].map for end in ends])
    bases, residuals = common_bases(
        edges, maps, len(members), np.array([trust[end] for end in ends])
    )
    own = [residuals[(edges == position).any(axis=1)] for position in range(len(members))]
    typical = np.array([float(np.median(values)) for values in own])
    return _vertices(session, shapes, members, bases, typical, rotations, surfaces)


def _similar(num: int, pairs: Sequence[AlignedPair]) -> list[AlignedPair]:
    """Return the pairs of similar shapes, which connect whatever all pairs do."""
    ends = np.array([_ends(pair) for pair in pairs]).reshape(-1, 2)
    kept = {
        tuple(edge)
        for edge in local_pairs(num, ends, np.array([pair.energy for pair in pairs])).tolist()
    }
    return [pair for pair in pairs if _ends(pair) in kept]


def _linked(pairs: Sequence[AlignedPair]) -> tuple[list[int], list[AlignedPair]]:
    """Return the largest set of shapes that pairs connect, the first of several, and the pairs within it."""
    graph = nx.Graph([_ends(pair) for pair in pairs])
    parts = sorted(
        (sorted(part) for part in nx.connected_components(graph)),
        key=lambda part: (-len(part), part),
    )
    members: list[int] = parts[0] if parts else []
    inside = set(members)
    return members, [pair for pair in pairs if pair.target in inside]


def _ends(pair: AlignedPair) -> tuple[int, int]:
    return pair.target, pair.source


def _edges(members: Sequence[int], pairs: Sequence[AlignedPair]) -> IntArray:
    """Return target and source of pairs, as positions among the members."""
    at = {shape: position for position, shape in enumerate(members)}
    return np.array([(at[pair.target], at[pair.source]) for pair in pairs])


def _of_pairs(
    job: Job[T],
    session: AlignSession,
    shapes: Shapes,
    surfaces: Results[int, SpectralShape],
    arguments: Mapping[tuple[int, int], Mapping[str, Any]],
) -> Results[tuple[int, int], T]:
    """Return what a job makes of the surfaces of pairs and of what it starts from; pairs that fail are left out."""
    wanted = {}
    for (target, source), own in arguments.items():
        both = surfaces.shared(target), surfaces.shared(source)
        wanted[target, source] = Wanted(
            key=job.key(
                {"function": job.run.__name__}
                | {name: np.asarray(value).tolist() for name, value in own.items()},
                *(one.key for one in both),
            ),
            label=shapes.label(target, source),
            arguments={"surfaces": both, **own},
        )
    limit_s = session.run.pair_time_limit_s
    return session.compute(job, wanted, time_limit_s=limit_s, strict=session.options.strict)


def _are_mirrored(rotations: FloatArray, target: int, source: int) -> bool:
    """Return whether one of two shapes, and not the other, is mirrored in the common frame."""
    return bool(np.linalg.det(rotations[target] @ rotations[source]) < 0)


def _vertices(
    session: AlignSession,
    shapes: Shapes,
    members: Sequence[int],
    bases: FloatArray,
    residuals: FloatArray,
    rotations: FloatArray,
    surfaces: Results[int, SpectralShape],
) -> VertexMaps:
    """Return the maps of all vertices that the bases give, through the most central shape."""
    centre = int(np.argmin(residuals))
    tasks = {
        shape: {
            "surfaces": (surfaces.shared(members[centre]), surfaces.shared(shape)),
            "bases": np.stack([bases[centre], bases[position]]),
            "mirrored": _are_mirrored(rotations, members[centre], shape),
        }
        for position, shape in enumerate(members)
    }
    found = session.map_parallel("maps of all vertices", places_on_reference, tasks)
    left_out = {
        i: surfaces.failures.get(i, "no-trusted-pair")
        for i in range(len(shapes.names))
        if i not in set(members)
    }
    return VertexMaps(
        names=tuple(shapes.names[i] for i in members),
        reference=shapes.names[members[centre]],
        places=tuple(read_only(found[shape][0]) for shape in members),
        confidence=read_only(np.array([found[shape][1] for shape in members])),
        vertex_confidence=tuple(read_only(found[shape][2]) for shape in members),
        left_out=tuple((shapes.names[i], reason) for i, reason in left_out.items()),
    )


def vertex_notes(found: VertexMaps | None) -> tuple[Note, ...]:
    """Return what a user must know of the maps of all vertices."""
    if found is None:
        return (Note("no-vertex-maps"),)
    notes = [
        Note("vertex-maps-missing", (name,), {"reason": reason}) for name, reason in found.left_out
    ]
    doubtful = np.flatnonzero(found.confidence < 0.5)
    if len(doubtful):
        names = tuple(found.names[i] for i in doubtful)
        notes.append(
            Note(
                "vertex-maps-doubtful",
                names,
                {"confidences": tuple(found.confidence[doubtful].tolist())},
            )
        )
    return tuple(notes)
