"""Repairs that every mesh needs before operators are built on it, each reported in a note, and fewer triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import fast_simplification
import numpy as np
import scipy
from numpy.typing import NDArray

from data_tools.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_faces,
    extremes,
    read_only,
    sums_by_owner,
)
from data_tools.errors import InputError
from data_tools.notes import Note
from data_tools.options import NUM_QUANTILES, CleaningOptions
from data_tools.surface.shape import Shape
from data_tools.surface.topology import (
    face_areas,
    face_crosses,
    mesh_components,
    spread_over_faces,
    vertex_components,
)

#: Edges of a mesh of more triangles are not collapsed one by one before vertices near each other are put together.
MOST_COLLAPSED = 200_000
#: The three clusters of a triangle fit into one integer of 64 bits.
_MOST_KEYED = 2**21
#: Cells of a cubic grid that a surface passes through, for an area of one cell's side.
_CELLS_PER_AREA = 1.5


def decimate(
    vertices: FloatArray, faces: IntArray, max_faces: int, *, most_collapsed: int = MOST_COLLAPSED
) -> tuple[FloatArray, IntArray]:
    """Return a mesh of at most about ``max_faces`` triangles by quadric decimation (Garland and Heckbert 1997).

    Of a mesh of more than ``most_collapsed`` triangles, vertices of one cell of a grid that edges inside the cell
    connect are first replaced by their mean (Rossignac and Borrel 1993, but sheets that only come near stay apart).

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
    max_faces : int
    most_collapsed : int
        A quarter as many vertices are left, about, before edges are collapsed.

    Returns
    -------
    vertices : ndarray, shape (w, 3)
    faces : ndarray of int, shape (g, 3)
        Some may be degenerate.
    """
    if len(faces) > most_collapsed:
        vertices, faces = _clustered(vertices, faces, most_collapsed // 4)
    if len(faces) <= max_faces:
        return vertices, faces
    # The thresholds of the library are lengths: without a common unit, millimetres and metres would differ.
    low, high = extremes(vertices)
    centre, unit = vertices.mean(axis=0), float((high - low).max()) or 1.0
    scaled = (vertices - centre) / unit
    small, triangles = fast_simplification.simplify(
        scaled, faces.astype(np.int32), target_count=max_faces
    )
    return unit * np.asarray(small, dtype=np.float64) + centre, np.asarray(
        triangles, dtype=np.int64
    )


def _clustered(
    vertices: FloatArray, faces: IntArray, num_clusters: int
) -> tuple[FloatArray, IntArray]:
    """Return a mesh of about so many vertices, the means of connected vertices of one cell."""
    side = float(np.sqrt(_CELLS_PER_AREA * face_areas(vertices, faces).sum() / num_clusters))
    low, high = extremes(vertices)
    x, y, z = np.floor((vertices - low) / side).astype(np.int64).T
    sizes = np.floor((high - low) / side).astype(np.int64) + 1
    cell = (x * sizes[1] + y) * sizes[2] + z
    corners = np.ascontiguousarray(faces.T)
    of = cell[corners]
    sides = ((corners[[i, i - 1]], of[i] == of[i - 1]) for i in range(3))
    num, cluster = vertex_components(
        len(vertices), (ends.compress(inside, axis=1).T for ends, inside in sides)
    )
    if num > _MOST_KEYED:
        return vertices, faces
    counts = np.bincount(cluster, minlength=num)
    means = sums_by_owner(vertices, cluster, num)
    a, b, c = corners = cluster[corners]
    triangles = corners.T[(a != b) & (b != c) & (c != a)]
    a, b, c = np.sort(triangles, axis=1).T
    # Where a fold of the surface became flat, two triangles lie on each other; neither is left.
    key = (a * num + b) * num + c
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    odd = np.diff(starts, append=len(key)) % 2 == 1
    return means / counts[:, None], triangles[np.sort(order[starts[odd]])]


#: A triangle is degenerate where its doubled area is at most this times its longest edge squared.
DEGENERATE_TOL = 1e-14
#: Components whose area is at least this share of the largest one's are kept with it: which of two bones in a file is
#: the larger one is chance, and would differ from file to file.
NEAR_TIE = 0.8
#: Where more than this share of the area of a shape is dropped with its smaller components, these are no
#: fragments. Scanned classes lose at most .04, assembled objects about half.
MOST_DROPPED = 0.05
#: The codes of the notes of a mesh of several components, and of one that lies beside larger pieces that are plain,
#: or beside pieces that the other files do not have.
COMPONENTS_KEPT, PLAIN_LEFT_OUT, SHARED_TAKEN = "components-kept", "plain-pieces", "shared-piece"
#: Components of less than this share of the largest one's area are not taken for the object.
LEAST_PIECE = 0.1
#: What files share tells the object if so many of them hold one piece. Another piece than the largest is the object
#: if it differs from the likest of these less than so many times what the largest does, and than so many times what
#: they usually differ by from each other.
LEAST_SINGLE, MUCH_LIKER, AS_USUAL = 1 / 3, 0.5, 1.5
#: Odd numbers that the bits of x, y and z are multiplied with, modulo 2^64.
_HASH_FACTORS = np.array(
    [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64
)
#: Largest share of vertices without finite coordinates that counts as a flaw of a mesh and not as damage.
MAX_NON_FINITE_SHARE = 0.05


def drop_non_finite(
    shape_name: str, vertices: FloatArray, faces: IntArray
) -> tuple[FloatArray, IntArray, IntArray, Note]:
    """Drop the vertices of a mesh whose coordinates are not finite, and their triangles.

    Parameters
    ----------
    shape_name : str
        For messages.
    vertices : ndarray, shape (v, 3)
        Some are NaN or infinite.
    faces : ndarray of int, shape (f, 3)

    Returns
    -------
    vertices : ndarray, shape (k, 3)
    faces : ndarray of int, shape (g, 3)
    kept : ndarray of int, shape (k,)
        Where each vertex was.
    note : Note
        What was dropped.

    Raises
    ------
    InputError
        If more than :data:`MAX_NON_FINITE_SHARE` of the vertices, or all triangles, would go.
    """
    faces = as_faces(faces, f"{shape_name}: faces", num_vertices=len(vertices))
    finite: BoolArray = np.asarray(np.isfinite(vertices).all(axis=1))
    num_bad = int((~finite).sum())
    good = finite[faces].all(axis=1)
    if num_bad > MAX_NON_FINITE_SHARE * len(vertices) or not good.any():
        raise InputError(
            f"{shape_name}: {num_bad} of {len(vertices)} vertices have coordinates that are NaN or infinite. The "
            f"file is damaged: at most {MAX_NON_FINITE_SHARE:.0%} can be left out. Save it again"
        )
    note = Note("non-finite-dropped", values={"vertices": num_bad, "triangles": int((~good).sum())})
    return vertices[finite], (np.cumsum(finite) - 1)[faces[good]], np.flatnonzero(finite), note


def clean(shape: Shape, options: CleaningOptions | None = None) -> Shape:
    """Merge duplicate vertices, drop degenerate faces, small components and unreferenced vertices.

    Parameters
    ----------
    shape : Shape
        A mesh or a point cloud (of which only duplicates are merged).
    options : CleaningOptions, optional

    Returns
    -------
    Shape
        With ``notes`` on what was changed and ``source_indices`` where vertices were removed.

    Raises
    ------
    InputError
        If a mesh has no face of positive area left.
    """
    options = CleaningOptions() if options is None else options
    vertices, faces, kept = shape.vertices, shape.faces, np.arange(len(shape.vertices))
    notes: list[Note] = []
    if options.merge_vertices:
        vertices, faces, kept = _merge_vertices(vertices, faces, kept, notes)
    if shape.is_mesh:
        faces, areas = _drop_degenerate(vertices, faces, notes)
        if not len(faces):
            raise InputError(
                f"{shape.file or shape.name}: every one of its {len(shape.faces)} triangles has zero area"
            )
        if options.components != "all":
            faces = _largest_components(vertices, faces, areas, notes, options.like)
        vertices, faces, kept = _drop_unreferenced(vertices, faces, kept, notes)
    if not notes:
        return shape
    source = shape.file_indices[kept]
    return Shape(
        name=shape.name,
        vertices=read_only(np.ascontiguousarray(vertices)),
        faces=read_only(np.ascontiguousarray(faces)),
        file=shape.file,
        notes=shape.notes + tuple(notes),
        source_indices=read_only(source)
        if len(source) < len(shape.vertices)
        else shape.source_indices,
        file_size=shape.file_size or len(shape.vertices),
    )


def _merge_vertices(
    vertices: FloatArray, faces: IntArray, kept: IntArray, notes: list[Note]
) -> tuple[FloatArray, IntArray, IntArray]:
    first, inverse = _places(vertices + 0.0)
    num_merged = len(vertices) - len(first)
    if not num_merged:
        return vertices, faces, kept
    order = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    notes.append(Note("duplicates-merged", values={"num": num_merged}))
    first = first[order]
    return vertices[first], rank[inverse][faces], kept[first]


def _places(vertices: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first vertex of each place, and the place of each vertex.

    To sort a hash of each row is far quicker than to sort the rows.
    """
    hashes = _hashes(vertices)
    if (np.diff(np.sort(hashes)) > 0).all():
        return np.arange(len(hashes)), np.arange(len(hashes))
    order = np.argsort(hashes)
    starts = np.flatnonzero(np.diff(hashes[order], prepend=hashes[order[:1]] + np.uint64(1)))
    first = np.minimum.reduceat(order, starts)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))
    if (vertices == vertices[first[place]]).all():
        return first, place
    _, first, place = np.unique(
        vertices, axis=0, return_index=True, return_inverse=True
    )  # hashes collide
    return first, place.ravel()


def _hashes(vertices: FloatArray) -> NDArray[np.uint64]:
    """Return an integer of 64 bits for each row."""
    bits = np.ascontiguousarray(vertices).view(np.uint64)
    bits = bits ^ (
        bits >> np.uint64(32)
    )  # the lower bits of what a file holds in single precision are all zero
    return np.asarray((bits * _HASH_FACTORS).sum(axis=1, dtype=np.uint64))


def _drop_degenerate(
    vertices: FloatArray, faces: IntArray, notes: list[Note]
) -> tuple[IntArray, FloatArray]:
    """Return the triangles that are left and their areas."""
    areas = face_areas(vertices, faces)
    low, high = extremes(vertices)
    good: BoolArray = np.asarray(2.0 * areas > DEGENERATE_TOL * float(((high - low) ** 2).sum()))
    doubtful = np.flatnonzero(~good)  # no side is longer than the diagonal
    sides = vertices[faces[doubtful]] - vertices[faces[doubtful][:, [2, 0, 1]]]
    longest_squared = np.einsum("fkd,fkd->fk", sides, sides).max(axis=1, initial=0.0)
    good[doubtful] = 2.0 * areas[doubtful] > DEGENERATE_TOL * longest_squared
    if not good.all():
        notes.append(Note("degenerate-dropped", values={"num": int((~good).sum())}))
    return faces[good], areas[good]


def _largest_components(
    vertices: FloatArray,
    faces: IntArray,
    face_area: FloatArray,
    notes: list[Note],
    like: tuple[float, ...],
) -> IntArray:
    """Return the triangles of the largest component, and of those nearly as large; plain ones are no object.

    Of several that may be the object, those of the one most ``like`` it are returned, where that is known.
    """
    of_face, areas = _components(vertices, faces, face_area)
    kept: BoolArray = np.asarray(areas >= NEAR_TIE * areas.max())
    beside = object_beside(vertices, faces, of_face, areas)
    if beside is not None:
        kept = np.arange(len(areas)) == beside
        share = float(areas[areas > areas[beside]].sum() / areas.sum())
        notes.append(Note(PLAIN_LEFT_OUT, values={"share": share}))
    elif like:
        pieces = _may_be_object(vertices, faces, of_face, areas)
        signs = np.array([piece_signature(vertices, faces[of_face == one]) for one in pieces])
        chosen = pieces[int(np.argmin(np.linalg.norm(signs - np.array(like), axis=1)))]
        others = (kept | (areas > areas[chosen])) & (np.arange(len(areas)) != chosen)
        if others.any():
            kept = np.arange(len(areas)) == chosen
            share = float(areas[others].sum() / areas.sum())
            notes.append(Note(SHARED_TAKEN, values={"share": share}))
    good = kept[of_face]
    if kept.sum() > 1 or not good.all():
        share = float(100.0 * areas[kept].sum() / areas.sum())
        numbers = {
            "kept": int(kept.sum()),
            "total": int((areas > 0).sum()),
            "dropped": int((~good).sum()),
        }
        which = (
            {"chosen": True} if notes and notes[-1].code in (PLAIN_LEFT_OUT, SHARED_TAKEN) else {}
        )
        notes.append(Note(COMPONENTS_KEPT, values={**numbers, "share": share, **which}))
    return faces[good]


def _components(
    vertices: FloatArray, faces: IntArray, face_area: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the component of each triangle (f,) and the areas of the components (c,)."""
    _, labels = mesh_components(len(vertices), faces)
    of_face = labels[faces[:, 0]]
    return of_face, np.bincount(of_face, weights=face_area).astype(np.float64)


def _may_be_object(
    vertices: FloatArray, faces: IntArray, of_face: IntArray, areas: FloatArray
) -> list[int]:
    """Return the components that may be the object: the largest one, and others that are large and not plain."""
    order = np.argsort(-areas, kind="stable")
    first, *others = order[areas[order] >= LEAST_PIECE * areas[order[0]]].tolist()
    return [first, *(one for one in others if not is_plain(vertices, faces[of_face == one]))]


def piece_signature(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return what a piece of a mesh looks like, whatever its pose and size, shape (16,).

    These are quantiles of the distances of its surface from its centroid, in root mean square radii.
    """
    points, _ = spread_over_faces(vertices, faces, PLAIN.num_points)
    radii = np.linalg.norm(points - points.mean(axis=0), axis=1)
    return np.quantile(radii, (np.arange(NUM_QUANTILES) + 0.5) / NUM_QUANTILES) / np.sqrt(
        (radii**2).mean()
    )


def piece_signatures(mesh: Shape) -> FloatArray:
    """Return the signatures of the pieces that may be the object, shape (p, 16), the one taken by itself first.

    Parameters
    ----------
    mesh : Shape
        With all of its components.
    """
    of_face, areas = _components(mesh.vertices, mesh.faces, face_areas(mesh.vertices, mesh.faces))
    beside = object_beside(mesh.vertices, mesh.faces, of_face, areas)
    pieces = (
        _may_be_object(mesh.vertices, mesh.faces, of_face, areas) if beside is None else [beside]
    )
    return np.array([piece_signature(mesh.vertices, mesh.faces[of_face == one]) for one in pieces])


def shared_object(signatures: Sequence[FloatArray]) -> tuple[float, ...]:
    """Return the signature of the object that shapes share, where some hold larger pieces; empty elsewhere.

    At least :data:`LEAST_SINGLE` of the shapes hold one piece only. Of another shape, a smaller piece is the object
    where one of these is much more like it than like the largest piece, and about as like as these are each other.

    Parameters
    ----------
    signatures : sequence of ndarray, each (p, 16)
        As of :func:`piece_signatures`, for each shape.
    """
    single = [i for i, own in enumerate(signatures) if len(own) == 1]
    if len(signatures) < 2 or len(single) < LEAST_SINGLE * len(signatures):
        return ()

    def unlike(i: int) -> FloatArray:
        """Return what each piece of a shape differs by from the likest of the other single ones, shape (p,)."""
        others = np.vstack(
            [np.empty((0, NUM_QUANTILES)), *(signatures[j] for j in single if j != i)]
        )
        return scipy.spatial.distance.cdist(signatures[i], others).min(axis=1, initial=np.inf)

    found = [unlike(i) for i in range(len(signatures))]
    usual = AS_USUAL * float(np.median([found[i][0] for i in single]))
    chosen = []
    for of_pieces in found:
        best = int(np.argmin(of_pieces))
        chosen.append(best if of_pieces[best] < min(MUCH_LIKER * of_pieces[0], usual) else 0)
    if not any(chosen):
        return ()
    objects = [own[at] for own, at in zip(signatures, chosen, strict=True)]
    return tuple(np.median(objects, axis=0).tolist())


class PlainTuning(NamedTuple):
    """Numbers by which an object is told from plain pieces that it was scanned with.

    Set once, on generated scenes; the objects that are assembled of boards are those of the families.
    """

    smallest: float = 0.02
    """Pieces of less than this share of the largest one's area are no object."""
    most_larger: int = 3
    """An object may lie beside so many larger plain pieces: a table, a wall, a cube."""
    num_points: int = 600
    """Points of a piece that are looked at."""
    flat: float = 0.1
    """A piece is flat if it is thinner than this share of its width, as standard deviations, ..."""
    num_sides: int = 6
    """... and a box if its normals lie around so many directions, ..."""
    within_cosine: float = 0.966
    """... within 15 degrees, ..."""
    of_box: float = 0.9
    """... so many of them."""
    times: float = 10.0
    """A larger box is a calibration cube if the object has so many times as many triangles; boards of furniture have
    as few as its other parts."""


#: The numbers in use.
PLAIN = PlainTuning()


def object_beside(
    vertices: FloatArray, faces: IntArray, of_face: IntArray, areas: FloatArray
) -> int | None:
    """Return the component that is the object where larger ones are flat or boxes; None where it is the largest.

    Tables, walls, scale bars and calibration cubes are plain; an object that is assembled of boards has no single
    component that is not.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
    of_face : ndarray of int, shape (f,)
        The component of each triangle.
    areas : ndarray, shape (c,)
        Of the components.
    """
    order = np.argsort(-areas, kind="stable")
    order = order[areas[order] >= PLAIN.smallest * areas[order[0]]].tolist()
    if len(order) < 2:
        return None
    pieces = [faces[of_face == one] for one in order]
    shown = range(min(len(order), PLAIN.most_larger + 1))
    at = next((k for k in shown if not is_plain(vertices, pieces[k])), 0)
    if at == 0 or not all(
        is_flat(vertices, piece) or PLAIN.times * len(piece) <= len(pieces[at])
        for piece in pieces[:at]
    ):
        return None
    has_rival = any(
        areas[other] >= NEAR_TIE * areas[order[at]] and not is_plain(vertices, piece)
        for other, piece in zip(order[at + 1 :], pieces[at + 1 :], strict=True)
    )
    return None if has_rival else order[at]


def is_flat(vertices: FloatArray, faces: IntArray) -> bool:
    """Return whether a piece of a mesh is thin compared with its width."""
    points, _ = spread_over_faces(vertices, faces, PLAIN.num_points)
    spreads = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T)), 0.0))
    return bool(spreads[0] < PLAIN.flat * spreads[1])


def is_plain(vertices: FloatArray, faces: IntArray) -> bool:
    """Return whether a piece of a mesh is flat, or a box."""
    if is_flat(vertices, faces):
        return True
    _, at = spread_over_faces(vertices, faces, PLAIN.num_points)
    crosses = face_crosses(vertices, faces).T[at]
    normals = crosses / np.linalg.norm(crosses, axis=1, keepdims=True)
    near = normals @ normals.T >= PLAIN.within_cosine
    left = np.ones(len(normals), dtype=np.bool_)
    for _ in range(PLAIN.num_sides):
        left &= ~near[int(np.argmax(near @ left))]
    return bool(left.mean() <= 1.0 - PLAIN.of_box)


def is_assembled(notes: Sequence[Note]) -> bool:
    """Return whether a shape is assembled of components: those that cleaning dropped are too much to be fragments.

    Parameters
    ----------
    notes : sequence of Note
        What cleaning said of the shape.
    """
    return 1.0 - share_kept(notes) > MOST_DROPPED


def _drop_unreferenced(
    vertices: FloatArray, faces: IntArray, kept: IntArray, notes: list[Note]
) -> tuple[FloatArray, IntArray, IntArray]:
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if used.all():
        return vertices, faces, kept
    notes.append(Note("unreferenced-dropped", values={"num": int((~used).sum())}))
    return vertices[used], (np.cumsum(used) - 1)[faces], kept[used]


def hold_pieces(notes: Sequence[Note]) -> bool:
    """Return whether a shape has another component that may be the object, by its notes."""
    kept = [note.values["kept"] for note in notes if note.code == COMPONENTS_KEPT]
    return share_kept(notes) < 1.0 / (1.0 + LEAST_PIECE) or any(num != 1 for num in kept)


def share_kept(notes: Sequence[Note]) -> float:
    """Return the share of the area, in [0, 1], that is in the components that cleaning kept, by its notes.

    The mean over meshes that were cleaned one by one.
    """
    shares = [float(str(note.values["share"])) for note in notes if note.code == COMPONENTS_KEPT]
    return float(np.mean(shares)) / 100.0 if shares else 1.0
