"""Walls inside a surface, which cannot be seen from outside: cavities, inner walls behind openings, second shells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.rotations import half_sphere
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.extra import without_vertices
from data_tools.surface.shape import MAX_DEFECTS, Shape, orientation_defects, vertex_normals
from data_tools.surface.topology import (
    boundary_edges,
    face_areas,
    face_crosses,
    mesh_components,
    mesh_edges,
    spread_over_faces,
    vertex_components,
)

#: The codes of the notes of a mesh with walls inside, and of one whose walls were left out.
WALLS, WALLS_LEFT_OUT = "inner-walls", "inner-walls-dropped"


class HiddenTuning(NamedTuple):
    """Numbers by which walls inside a surface are found.

    Set once, on generated bodies with second walls, sealed or with an opening. Of the recesses of mouse skulls and
    feet, of which a quarter cannot be seen either, the rims are 10 to 30 times the root of their area.
    """

    num_glanced: int = 2_000
    """Points of a surface that are looked at first, ..."""
    glances: int = 13
    """... from so many directions of a half sphere and the opposite ones."""
    worth: float = 0.03
    """Where more than this share of the area cannot be seen then, all vertices are looked at. Walls of less than this
    share count as none."""
    num_points: int = 8_000
    """By so many points that may lie before them, ..."""
    looks: int = 24
    """... from so many directions."""
    pixel: float = 2.5
    """Sides of a pixel, in mean distances of the points: several lie in each."""
    behind: float = 2.0
    """What lies so many pixels behind the foremost point of its pixel is not seen."""
    least_faced: float = 0.3
    """A point can be seen from directions that its normal meets at this cosine or more."""
    seen: tuple[float, ...] = (0.05, 0.15, 0.3)
    """It is hidden if it is seen from at most the first share of these. Through an opening, a wall is seen from more:
    pieces up to each of these shares may be walls, ..."""
    least_hidden: float = 0.3
    """... if so much of the piece is hidden, ..."""
    least_piece: float = 0.01
    """... it has so much of the whole area, ..."""
    longest_rim: float = 2.0
    """... and its rim, where it joins what is seen, is shorter than this times the root of its area."""
    touching: float = 1e-3
    """A component is a second shell where its points lie within the largest one, or beyond it by less than this times
    the root of its area, ..."""
    within: float = 0.95
    """... so many of them, ..."""
    num_compared: int = 300
    """... of so many that are looked at."""
    much: float = 0.1
    """Shapes differ by their walls where one has at least this share of its area in walls, and another none."""


#: The numbers in use.
TUNED = HiddenTuning()


def inner_walls(mesh: Shape) -> BoolArray:
    """Return which vertices (v,) are of walls inside a mesh; none where its triangles have no sides.

    These are components within the largest one, and pieces of the surface that cannot be seen from outside and are
    joined to the rest at short rims, if at all. Recesses, which have long rims, are no walls.

    Parameters
    ----------
    mesh : Shape
    """
    walls = np.zeros(len(mesh.vertices), dtype=np.bool_)
    if orientation_defects(mesh) > MAX_DEFECTS:
        return walls
    walls = _inner_shells(mesh)
    points, normals, spacing = _spread(mesh, TUNED.num_glanced)
    glanced = _seen_shares(points, spacing, points, normals, TUNED.glances)
    if (glanced <= TUNED.seen[0]).mean() <= TUNED.worth:
        return walls
    points, _, spacing = _spread(mesh, TUNED.num_points)
    outward = vertex_normals(mesh.vertices, mesh.faces) * _side(mesh)
    seen = _seen_shares(points, spacing, mesh.vertices, outward, TUNED.looks)
    edges, areas = mesh_edges(mesh.faces), face_areas(mesh.vertices, mesh.faces)
    for most_seen in TUNED.seen:
        walls |= _walls_among(mesh, edges, areas, seen, most_seen)
    return walls


def _inner_shells(mesh: Shape) -> BoolArray:
    """Return which vertices (v,) are of components that lie within the largest one, or on it."""
    num, piece = mesh_components(len(mesh.vertices), mesh.faces)
    inner = np.zeros(len(mesh.vertices), dtype=np.bool_)
    if num < 2:
        return inner
    areas = np.bincount(
        piece[mesh.faces[:, 0]], weights=face_areas(mesh.vertices, mesh.faces), minlength=num
    )
    largest = int(np.argmax(areas))
    faces = mesh.faces[piece[mesh.faces[:, 0]] == largest]
    outer = replace(mesh, faces=faces)
    locator = SurfaceLocator(mesh.vertices, faces)
    normals = vertex_normals(mesh.vertices, faces) * _side(outer)
    reach = TUNED.touching * np.sqrt(areas[largest])
    for other in np.flatnonzero(areas >= TUNED.least_piece * areas.sum()):
        if other == largest:
            continue
        own = np.flatnonzero(piece == other)
        places = mesh.vertices[own[:: -(-len(own) // TUNED.num_compared)]]
        nearest = locator.closest(places)
        heights = np.einsum("pa,pa->p", places - nearest.on(mesh.vertices), nearest.on(normals))
        inner[own] = (heights <= reach).mean() >= TUNED.within
    return inner


def _walls_among(
    mesh: Shape, edges: IntArray, areas: FloatArray, seen: FloatArray, most_seen: float
) -> BoolArray:
    """Return the vertices of the pieces seen from at most so many directions that are walls, shape (v,)."""
    total = areas.sum()
    of_vertex = np.bincount(
        mesh.faces.ravel(), weights=np.repeat(areas / 3.0, 3), minlength=len(seen)
    )
    piece_of, shares = _pieces(edges, seen <= most_seen, of_vertex / total)
    # Specks within a piece belong to it.
    inside = (seen <= most_seen) & (shares[piece_of] >= TUNED.least_piece)
    piece_of, shares = _pieces(edges, ~inside, of_vertex / total)
    inside |= shares[piece_of] < TUNED.least_piece
    piece_of, shares = _pieces(edges, inside, of_vertex / total)
    faces = mesh.faces[inside[mesh.faces].all(axis=1)]
    border = boundary_edges(faces) if len(faces) else edges[:0]
    lengths = np.linalg.norm(mesh.vertices[border[:, 0]] - mesh.vertices[border[:, 1]], axis=1)
    rims = np.bincount(piece_of[border[:, 0]], weights=lengths, minlength=len(shares))
    hidden = np.bincount(
        piece_of, weights=np.where(seen <= TUNED.seen[0], of_vertex, 0.0), minlength=len(shares)
    )
    are_walls = (
        (shares >= TUNED.least_piece)
        & (rims < TUNED.longest_rim * np.sqrt(shares * total))
        & (hidden >= TUNED.least_hidden * shares * total)
    )
    return np.asarray(inside & are_walls[piece_of])


def _pieces(edges: IntArray, member: BoolArray, weights: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the connected piece of each vertex (v,) among the members, and the weight of each piece."""
    num, piece = vertex_components(len(member), [edges[member[edges].all(axis=1)]])
    return piece, np.bincount(piece, weights=weights, minlength=num).astype(np.float64)


def wall_share(mesh: Shape, walls: BoolArray) -> float:
    """Return the share of the area of a mesh that is of walls (v,)."""
    areas = face_areas(mesh.vertices, mesh.faces)
    return float(areas[walls[mesh.faces].all(axis=1)].sum() / areas.sum())


def as_seen(shape: Shape, options: CleaningOptions) -> Shape:
    """Return a shape with a note on the walls inside it, or without these where the options say so.

    Objects that are assembled of components stay: the surface around these is matched.

    Parameters
    ----------
    shape : Shape
    options : CleaningOptions
    """
    if options.inner == "keep" or not shape.is_mesh:
        return shape
    if options.components == "all" and mesh_components(len(shape.vertices), shape.faces)[0] > 1:
        return shape
    walls = inner_walls(shape)
    share = wall_share(shape, walls)
    if share <= TUNED.worth:
        return shape
    if options.inner == "drop":
        rest = without_vertices(shape, walls, replace(options, components="all"), apart=True)
        return replace(rest, notes=(*shape.notes, Note(WALLS_LEFT_OUT, values={"share": share})))
    return replace(shape, notes=(*shape.notes, Note(WALLS, values={"share": share})))


def differ_in_walls(notes: Sequence[Sequence[Note]], are_sided: Sequence[bool]) -> bool:
    """Return whether some shapes have much of their area in walls inside, and others none.

    Parameters
    ----------
    notes : sequence of sequence of Note
        Of each shape, as :func:`as_seen` makes them.
    are_sided : sequence of bool
        Whether the triangles of each shape agree on a side; of others nothing is known.
    """
    shares = [
        max((float(str(one.values["share"])) for one in own if one.code == WALLS), default=0.0)
        for own in notes
    ]
    none = any(share == 0.0 and sided for share, sided in zip(shares, are_sided, strict=True))
    return none and max(shares, default=0.0) >= TUNED.much


def _side(mesh: Shape) -> float:
    """Return 1, or -1 where the mesh is inside out: what is outermost encloses most."""
    arms = mesh.vertices - mesh.vertices.mean(axis=0)
    volume = np.vdot(face_crosses(arms, mesh.faces), arms.T[:, mesh.faces[:, 0]])
    return -1.0 if volume < 0 else 1.0


def _spread(mesh: Shape, num: int) -> tuple[FloatArray, FloatArray, float]:
    """Return points on a mesh with their outward normals, each (num, 3), and how far they lie apart."""
    points, faces = spread_over_faces(mesh.vertices, mesh.faces, num)
    crosses = face_crosses(mesh.vertices, mesh.faces).T
    normals = crosses[faces] / np.linalg.norm(crosses[faces], axis=1, keepdims=True)
    area = float(face_areas(mesh.vertices, mesh.faces).sum())
    return points, normals * _side(mesh), float(np.sqrt(area / num))


def _seen_shares(
    points: FloatArray,
    spacing: float,
    places: FloatArray,
    normals: FloatArray,
    num_directions: int,
) -> FloatArray:
    """Return from what share of the directions that they face places (p, 3) are seen, shape (p,).

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Spread over the surface.
    spacing : float
        How far these lie apart.
    places, normals : ndarray, shape (p, 3)
    num_directions : int
        Of a half sphere; the opposite ones are taken as well.
    """
    side = TUNED.pixel * spacing
    seen, faced = np.zeros(len(places)), np.zeros(len(places))
    for sight in half_sphere(num_directions):
        axes = np.concatenate([np.linalg.svd(sight[None])[2][1:], sight[None]])
        along, own = points @ axes.T, places @ axes.T
        corner = np.minimum(along[:, :2].min(axis=0), own[:, :2].min(axis=0))
        pixels, at = (np.floor((of[:, :2] - corner) / side).astype(np.int64) for of in (along, own))
        width = int(max(pixels[:, 1].max(), at[:, 1].max())) + 1
        keys, own_keys = pixels[:, 0] * width + pixels[:, 1], at[:, 0] * width + at[:, 1]
        size = int(max(keys.max(), own_keys.max())) + 1
        cosines = normals @ sight
        for sign in (1.0, -1.0):
            front = np.full(size, -np.inf)
            np.maximum.at(front, keys, sign * along[:, 2])
            facing = sign * cosines >= TUNED.least_faced
            faced += facing
            seen += facing & (front[own_keys] - sign * own[:, 2] < TUNED.behind * side)
    return np.where(faced > 0, seen / np.maximum(faced, 1.0), 1.0)
