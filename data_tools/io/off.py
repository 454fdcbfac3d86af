"""The Object File Format: small enough to read here, where a damaged line can be named."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.source import Source
from data_tools.io.text_tables import filled_lines, parse_table


def read_off(source: Source) -> tuple[FloatArray, IntArray]:
    """Return the vertices and triangles of a text OFF file; normals, colours and textures are ignored.

    Polygons are split into triangles at their first corner; polygons of fewer than three corners are left out.

    Raises
    ------
    InputError
        If it is not OFF, truncated, or a line is not what its place asks for.
    """
    path, text = source.path, re.sub("#.*", "", source.text())
    starts, _ = filled_lines(text)
    num_vertices, num_faces, num_lines = _counts(path, _lines(text[: starts[2] if len(starts) > 2 else None]))
    body = starts[num_lines:]
    if len(body) < num_vertices + num_faces:
        raise InputError(
            f"{path}: truncated, its header promises {num_vertices} vertices and {num_faces} faces, "
            f"{len(body)} lines follow"
        )
    ends = np.append(body, len(text))
    first, middle, last = ends[0], ends[num_vertices], ends[num_vertices + num_faces]
    vertices = _vertices(path, text[first:middle], num_vertices)
    return vertices, _triangles(path, text[middle:last], num_faces, num_vertices)


def _lines(text: str) -> list[str]:
    """Return the lines that are not blank."""
    return [line.strip() for line in text.split("\n") if line.strip()]


def _counts(path: Path, lines: list[str]) -> tuple[int, int, int]:
    """Return the numbers of vertices and faces, and of the lines of the header."""
    first = lines[0].split() if lines else [""]
    if re.fullmatch(r"(ST)?C?N?OFF", first[0]) is None:
        raise InputError(f"{path}: not an OFF file of three dimensions, its first word is not OFF")
    counts, num_lines = (first[1:], 1) if len(first) > 1 else ("".join(lines[1:2]).split(), 2)
    if len(counts) < 2 or not all(word.isdecimal() for word in counts[:2]):
        raise InputError(f"{path}: its OFF header holds no counts of vertices and faces")
    return int(counts[0]), int(counts[1]), num_lines


def _vertices(path: Path, text: str, num_vertices: int) -> FloatArray:
    table = parse_table(text, num_rows=num_vertices)
    if table is not None and table.shape[1] >= 3:
        return np.ascontiguousarray(table[:, :3])
    vertices = []
    for position, line in enumerate(_lines(text)):
        try:
            x, y, z = (float(word) for word in line.split()[:3])
        except ValueError:
            raise InputError(f"{path}: vertex {position} is not three numbers") from None
        vertices.append((x, y, z))
    return np.array(vertices, dtype=np.float64).reshape(-1, 3)


def _triangles(path: Path, text: str, num_faces: int, num_vertices: int) -> IntArray:
    table = parse_table(text, num_rows=num_faces)
    if table is not None and table.shape[1] >= 4 and (table[:, 0] == 3).all():
        corners = table[:, 1:4]
        if ((corners >= 0) & (corners < num_vertices) & (corners == np.floor(corners))).all():
            return np.ascontiguousarray(corners.astype(np.int64))
    triangles: list[list[int]] = []
    for position, line in enumerate(_lines(text)):
        words = line.split()
        if not words[0].isdecimal() or len(words) <= int(words[0]):
            raise InputError(f"{path}: face {position} is not a count and as many vertices (truncated?)")
        corners_of_face = words[1 : 1 + int(words[0])]
        if not all(word.isdecimal() and int(word) < num_vertices for word in corners_of_face):
            raise InputError(f"{path}: face {position} has an index outside of 0 to {num_vertices - 1}")
        polygon = [int(word) for word in corners_of_face]
        triangles.extend([polygon[0], b, c] for b, c in pairwise(polygon[1:]))
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)
