"""What a reader returns, and what readers share: polygons and strips become triangles, indices are checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.notes import Note

#: The code of the note of a file that has more than its surface.
NOT_KEPT = "not-kept"


class RawShape(NamedTuple):
    """What a file holds, as it stands: neither merged nor repaired.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Empty for a point cloud.
    notes : tuple of Note
        What was not read.
    places : ndarray of int, shape (v,), or None
        Where the file has points without coordinates: the number of each vertex in the file. None: all are here.
    file_size : int or None
        How many points the file has, where ``places`` is given.
    """

    vertices: FloatArray
    faces: IntArray
    notes: tuple[Note, ...] = ()
    places: IntArray | None = None
    file_size: int | None = None


def no_faces() -> IntArray:
    """Return the triangles of a point cloud, shape (0, 3)."""
    return np.empty((0, 3), dtype=np.int64)


def not_kept(things: Iterable[str]) -> tuple[Note, ...]:
    """Return the note that names what a file has and a :class:`RawShape` has not; none if that is nothing."""
    named = sorted(set(things))
    return (Note(NOT_KEPT, values={"things": tuple(named)}),) if named else ()


def content_not_kept(notes: Mapping[str, Sequence[Note]]) -> tuple[Note, ...]:
    """Return the note that names what no output has of the files of a collection; none if that is nothing.

    Parameters
    ----------
    notes : mapping of str to sequence of Note
        The notes of each shape by its name.
    """
    found = {
        name: note.values["things"]
        for name, own in notes.items()
        for note in own
        if note.code == NOT_KEPT
    }
    if not found:
        return ()
    things = dict.fromkeys(
        str(thing) for of in found.values() for thing in (of if isinstance(of, tuple) else (of,))
    )
    return (Note("content-not-kept", tuple(found), {"things": tuple(things), "total": len(notes)}),)


def fan_triangles(corners: IntArray, sizes: IntArray) -> IntArray:
    """Split polygons into triangles at their first corner.

    Parameters
    ----------
    corners : ndarray of int, shape (c,)
        Of all polygons, one after the other.
    sizes : ndarray of int, shape (p,)
        Number of corners of each; fewer than three give no triangle.

    Returns
    -------
    ndarray of int, shape (f, 3)
    """
    first, step = _each_triangle(sizes)
    return corners[np.column_stack([first, first + step + 1, first + step + 2])]


def strip_triangles(corners: IntArray, sizes: IntArray) -> IntArray:
    """Return the triangles of strips, every second one turned round; those with a corner twice are left out.

    Parameters
    ----------
    corners : ndarray of int, shape (c,)
        Of all strips, one after the other.
    sizes : ndarray of int, shape (p,)
        Number of corners of each.

    Returns
    -------
    ndarray of int, shape (f, 3)
    """
    first, step = _each_triangle(sizes)
    odd = step % 2
    triangles = corners[
        np.column_stack([first + step + odd, first + step + 1 - odd, first + step + 2])
    ]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def _each_triangle(sizes: IntArray) -> tuple[IntArray, IntArray]:
    """Return of each triangle where the corners of its polygon begin, and which of its triangles it is."""
    num = np.maximum(sizes - 2, 0)
    starts = np.cumsum(sizes) - sizes
    step = np.arange(num.sum()) - np.repeat(np.cumsum(num) - num, num)
    return np.repeat(starts, num), step


def checked_indices(path: Path, values: ArrayLike, num_vertices: int) -> IntArray:
    """Return vertex numbers (any shape) as integers.

    Raises
    ------
    InputError
        If one is no whole number, or names a vertex that does not exist.
    """
    given = np.asarray(values)
    if not given.size:
        return np.empty(given.shape, dtype=np.int64)
    if given.dtype.kind == "f" and not (given == np.floor(given)).all():
        raise InputError(f"{path}: a face names a vertex by a number that is not whole")
    low, high = given.min(), given.max()
    if low < 0 or high >= num_vertices:
        wrong = int(low if low < 0 else high)
        raise InputError(
            f"{path}: a face names vertex {wrong}, there are {num_vertices}, counted from 0"
        )
    return given.astype(np.int64)


def joined(parts: Sequence[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    """Return the meshes of one file, (v, 3) and (f, 3), as one mesh, the vertices of each after those before."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    vertices = np.concatenate([np.empty((0, 3)), *(vertices for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, starts[:-1], strict=True)]
    return vertices, np.concatenate([no_faces(), *faces])
