"""Wavefront OBJ, read here because its vertices must keep their order: landmarks and maps name them by number."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import RawShape, not_kept
from data_tools.io.source import Source
from data_tools.io.text_tables import parse_table
from data_tools.notes import Note

#: A comment, which the sign in 1.#QNAN does not begin.
_COMMENT = re.compile(r"(?<!1\.)#.*")


def read_obj(source: Source) -> RawShape:
    """Return the vertices (v, 3) and triangles (t, 3) of an OBJ file; only ``v`` and ``f`` are read, groups joined.

    Polygons are split into triangles at their first corner; those of fewer than three corners are left out. Indices
    count from 1, or from the end where negative.

    Raises
    ------
    InputError
        If there are no vertices, or a line of either kind is malformed.
    """
    points: list[str] = []
    polygons: list[str] = []
    num_before: list[int] = []
    path, text = source.path, source.text().replace("\\\n", " ")
    for line in text.splitlines():
        content = _COMMENT.sub("", line).strip()
        if content[:2] in ("v ", "v\t", "v"):
            points.append(content[1:])
        elif content[:2] in ("f ", "f\t", "f"):
            polygons.append(content[1:])
            num_before.append(len(points))
    if not points:
        raise InputError(f"{path}: not an OBJ file, it has no vertex lines 'v x y z'")
    faces = _triangles(path, polygons, num_before)
    if faces.size and faces.max() >= len(points):
        raise InputError(f"{path}: a face names vertex {faces.max() + 1}, there are {len(points)}")
    return RawShape(vertices_of_lines(path, points), faces, _lost(text, points[0]))


def _lost(text: str, point: str) -> tuple[Note, ...]:
    """Return the note that names what else the file has; colours stand behind the coordinates of a vertex."""
    words = {"vt": "texture coordinates", "usemtl": "materials"}
    things = [
        thing for word, thing in words.items() if re.search(rf"^{word}\s", text, re.MULTILINE)
    ]
    return not_kept(things + ["colours"] * (len(point.split()) >= 6))


def vertices_of_lines(path: Path, lines: list[str], *, first: int = 1) -> FloatArray:
    """Return the first three numbers of each line, shape (v, 3).

    Raises
    ------
    InputError
        If a line has fewer; the first one is counted as ``first``.
    """
    table = parse_table("\n".join(lines), num_rows=len(lines))
    if table is not None and table.shape[1] >= 3:
        return np.ascontiguousarray(table[:, :3])
    vertices = []
    for position, line in enumerate(lines, start=first):
        try:
            x, y, z = (float(word) for word in line.split()[:3])
        except ValueError:
            why = "save it with decimal points" if "," in line else "truncated?"
            raise InputError(f"{path}: vertex {position} is not three numbers ({why})") from None
        vertices.append((x, y, z))
    return np.array(vertices).reshape(-1, 3)


def _triangles(path: Path, lines: list[str], num_before: list[int]) -> IntArray:
    table = parse_table("\n".join(lines), num_rows=len(lines))
    if (
        table is not None
        and table.shape[1] == 3
        and (table >= 1).all()
        and (table == np.floor(table)).all()
    ):
        return table.astype(np.int64) - 1
    triangles: list[list[int]] = []
    for position, (line, before) in enumerate(zip(lines, num_before, strict=True), start=1):
        polygon = [_corner(path, position, word, before) for word in line.split()]
        if len(polygon) < 3 and position == len(lines):
            raise InputError(f"{path}: face {position} has {len(polygon)} corners (truncated?)")
        triangles.extend(fan(polygon))
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def fan(polygon: list[int]) -> list[list[int]]:
    """Return the triangles into which a polygon is split at its first corner; none of fewer than three."""
    return [[polygon[0], b, c] for b, c in pairwise(polygon[1:])]


def _corner(path: Path, position: int, word: str, num_before: int) -> int:
    """Return the index, from 0, of a corner ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``."""
    digits = word.split("/", 1)[0]
    if not digits.removeprefix("-").isdecimal() or int(digits) == 0:
        raise InputError(
            f"{path}: face {position} has a word that is no corner v, v/vt, v//vn or v/vt/vn"
        )
    if num_before + int(digits) < 0:
        raise InputError(
            f"{path}: face {position} names vertex {int(digits)}, there are {num_before} before it"
        )
    return int(digits) - 1 if int(digits) > 0 else num_before + int(digits)
