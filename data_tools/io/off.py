"""OFF, the text format of Geomview, read here because other readers take each word apart."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from data_tools.arrays import IntArray
from data_tools.errors import InputError
from data_tools.io.formats.raw_shape import RawShape, not_kept
from data_tools.io.obj import fan, vertices_of_lines
from data_tools.io.source import Source
from data_tools.io.text_tables import parse_table

_COMMENT = re.compile(r"(?<!1\.)#.*")
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
    faces = _triangles(path, rows)
    if faces.size and faces.max() >= num_vertices:
        raise InputError(
            f"{path}: a face names vertex {faces.max()}, there are {num_vertices}, counted from 0"
        )
    return RawShape(
        vertices, faces, not_kept(["colours"] if header["colours"] or _has_colour(rows) else [])
    )


def _has_colour(rows: list[str]) -> bool:
    """Return whether numbers stand behind the corners of the first face."""
    return bool(rows) and len(rows[0].split()) > 1 + int(rows[0].split()[0])


def _triangles(path: Path, lines: list[str]) -> IntArray:
    table = parse_table("\n".join(lines), num_rows=len(lines))
    if table is not None and table.shape[1] >= 4 and (table[:, 0] == 3).all():
        corners = table[:, 1:4]
        if (corners >= 0).all() and (corners == np.floor(corners)).all():
            return corners.astype(np.int64)
    triangles: list[list[int]] = []
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
        triangles.extend(fan([int(word) for word in words[: int(number)]]))
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)
