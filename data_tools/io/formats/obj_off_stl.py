"""Wavefront OBJ, OFF and STL. Vertices of OBJ and OFF keep their order, as landmarks and maps name them.

STL is read, binary and text, as many programs write it: with bytes behind it, without a count or without an end.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import RawShape, checked_indices, fan_triangles, not_kept
from data_tools.io.source import Source
from data_tools.io.text_tables import parse_table
from data_tools.notes import Note

#: A comment, which the sign in 1.#QNAN does not begin.
_COMMENT = re.compile(r"(?<!1\.)#.*")
#: A triangle of the binary format.
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: The name of a solid may hold any word; on one line with the first triangle it ends there.
_STL_NAME = re.compile(
    rb"^[ \t]*solid\b.*?(?=\bfacet\s+normal\s+[-+.\dni]|$)|(?:^[ \t]*|(?<=endfacet)[ \t]+)endsolid\b.*$",
    re.IGNORECASE | re.MULTILINE,
)
_STL_VERTEX = re.compile(rb"\bvertex\s+(\S+\s+\S+\s+\S+)", re.IGNORECASE)


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
    faces = _obj_faces(path, polygons, num_before, ends=text.endswith(("\n", "\r")))
    if faces.size and faces.max() >= len(points):
        raise InputError(f"{path}: a face names vertex {faces.max() + 1}, there are {len(points)}")
    return RawShape(vertices_of_lines(path, points), faces, _lost(text, points[0]))


def _lost(text: str, point: str) -> tuple[Note, ...]:
    """Return the note that names what else the file has; colours stand behind the coordinates of a vertex."""
    words = {"vt": "texture coordinates", "usemtl": "materials", "l": "lines"}
    things = [
        thing for word, thing in words.items() if re.search(rf"^{word}\s", text, re.MULTILINE)
    ]
    return not_kept(things + ["colours"] * (len(point.split()) >= 6))


def vertices_of_lines(path: Path, lines: list[str], *, first: int = 1) -> FloatArray:
    """Return the vertices of lines of an OBJ, OFF or STL file: the first three numbers of each, shape (v, 3).

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


def _obj_faces(path: Path, lines: list[str], num_before: list[int], *, ends: bool) -> IntArray:
    """Return the triangles (t, 3) of the faces in lines; ``ends`` says whether the last line of the file is finished.

    Modellers write edges as faces of two corners. The last face may be one too, if its line is finished and others
    have three.
    """
    table = parse_table("\n".join(lines), num_rows=len(lines))
    if (
        table is not None
        and table.shape[1] == 3
        and (table >= 1).all()
        and (table == np.floor(table)).all()
    ):
        return table.astype(np.int64) - 1
    polygons = [
        [_corner(path, position, word, before) for word in line.split()]
        for position, (line, before) in enumerate(zip(lines, num_before, strict=True), start=1)
    ]
    is_edge = ends and any(len(polygon) >= 3 for polygon in polygons)
    if polygons and len(polygons[-1]) < 3 and not is_edge:
        raise InputError(f"{path}: face {len(lines)} has {len(polygons[-1])} corners (truncated?)")
    return _split(polygons)


def _split(polygons: Sequence[Sequence[int]]) -> IntArray:
    """Return the triangles (t, 3) of polygons given by their corners."""
    sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    return fan_triangles(np.array([*chain(*polygons)], dtype=np.int64), sizes)


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


#: The word OFF, which may be missing or stand before its counts without a blank (ModelNet), and the counts.
_HEADER = re.compile(
    r"\s*(?=\d+\s|(?:ST)?C?N?OFF)(?:(?:ST)?(?P<colours>C)?N?OFF)?\s*(?P<binary>BINARY)?"
    r"(?:(?P<vertices>\d{1,18})[ \t]+(?P<faces>\d{1,18})(?:[ \t]+\d+)?[ \t]*(?:\n|$))?",
    re.IGNORECASE,
)


def read_off(source: Source) -> RawShape:
    """Return the vertices (v, 3) and triangles (t, 3) of an OFF file; normals, colours and edges are ignored.

    Polygons are split into triangles at their first corner. The word OFF may be missing.

    Raises
    ------
    InputError
        If it is not OFF of three dimensions, ends early, or a line is malformed.
    """
    path = source.path
    text = _COMMENT.sub("", source.text())
    header = _HEADER.match(text)
    if header is None:
        raise InputError(f"{path}: not an OFF file of three dimensions, its first word is not OFF")
    if header["binary"]:
        raise InputError(f"{path}: is binary OFF, which is not read; save it as text, or as PLY")
    if header["vertices"] is None:
        raise InputError(f"{path}: its OFF header holds no counts of vertices and faces")
    num_vertices, num_faces = int(header["vertices"]), int(header["faces"])
    body = [line for line in text[header.end() :].split("\n") if line.strip()]
    if len(body) < num_vertices + num_faces:
        raise InputError(
            f"{path}: truncated, its header promises {num_vertices} vertices and {num_faces} faces, "
            f"{len(body)} lines follow"
        )
    vertices = vertices_of_lines(path, body[:num_vertices], first=0)
    rows = body[num_vertices : num_vertices + num_faces]
    faces = checked_indices(path, _off_faces(path, rows), num_vertices)
    return RawShape(
        vertices, faces, not_kept(["colours"] if header["colours"] or _has_colour(rows) else [])
    )


def _has_colour(rows: list[str]) -> bool:
    """Return whether numbers stand behind the corners of the first face."""
    return bool(rows) and len(rows[0].split()) > 1 + int(rows[0].split()[0])


def _off_faces(path: Path, lines: list[str]) -> IntArray:
    table = parse_table("\n".join(lines), num_rows=len(lines))
    if table is not None and table.shape[1] >= 4 and (table[:, 0] == 3).all():
        corners = table[:, 1:4]
        if (corners >= 0).all() and (corners == np.floor(corners)).all():
            return corners.astype(np.int64)
    polygons = []
    for position, line in enumerate(lines):
        number, *words = line.split()
        if (
            not number.isdecimal()
            or len(words) < int(number)
            or not all(map(str.isdecimal, words[: int(number)]))
        ):
            raise InputError(
                f"{path}: face {position} is not a count and as many vertices (truncated?)"
            )
        polygons.append([int(word) for word in words[: int(number)]])
    return _split(polygons)


def read_stl(source: Source) -> RawShape:
    """Return the triangles of an STL file, each with vertices of its own.

    Raises
    ------
    InputError
        If the file is truncated, or no STL.
    """
    path, content = source.path, source.content
    text = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    is_text = text[:5].lower() == b"solid" and b"\0" not in text[:1000]
    vertices, notes = _read_stl_text(path, text) if is_text else _read_stl_binary(path, content)
    return RawShape(vertices, np.arange(len(vertices)).reshape(-1, 3), notes)


def _read_stl_binary(path: Path, content: bytes) -> tuple[FloatArray, tuple[Note, ...]]:
    promised = int.from_bytes(content[80:84], "little")
    room, rest = divmod(max(len(content) - 84, 0), STL_TRIANGLE.itemsize)
    is_unknown = promised in (
        0,
        2**32 - 1,
    )  # of programs that write the header first and never come back to it
    num = room if is_unknown and rest == 0 else promised
    if not 0 < num <= room:
        raise InputError(
            f"{path}: not an STL file, or truncated. It does not begin with 'solid', and its {len(content)} bytes "
            f"do not fit the {promised} triangles that a binary header promises"
        )
    triangles = np.frombuffer(content, dtype=STL_TRIANGLE, count=num, offset=84)
    ignored = len(content) - 84 - num * STL_TRIANGLE.itemsize
    notes = (Note("bytes-ignored", values={"num": ignored}),) if ignored else ()
    colours = not_kept(["colours"] if b"COLOR=" in content[:80] else [])
    return triangles["corners"].reshape(-1, 3).astype(np.float64), notes + colours


def _read_stl_text(path: Path, text: bytes) -> tuple[FloatArray, tuple[Note, ...]]:
    body = _STL_NAME.sub(b"", text.replace(b"\r", b"\n")).rstrip(b"\0 \t\n\x1a")
    rows = [row.decode("ascii", "replace") for row in _STL_VERTEX.findall(body)]
    num_ends = len(re.findall(rb"\bendfacet\b", body, re.IGNORECASE))
    if not rows or len(rows) != 3 * num_ends or not body.lower().endswith(b"endfacet"):
        raise InputError(
            f"{path}: truncated STL text, {len(rows)} vertices in {num_ends} complete triangles"
        )
    notes = (
        () if re.search(rb"\bendsolid\b", text[-1000:], re.IGNORECASE) else (Note("no-endsolid"),)
    )
    return vertices_of_lines(path, rows), notes
