"""The Object File Format: small enough to read here, where a damaged line can be named."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError

Lines = list[tuple[int, list[str]]]


def read_off(path: Path) -> tuple[FloatArray, IntArray]:
    """Return the vertices and triangles of a text OFF file; normals, colours and textures are ignored.

    Polygons are split into triangles at their first corner; polygons of fewer than three corners are left out.

    Raises
    ------
    InputError
        If it is not OFF, truncated, or a line is not what its place asks for.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    numbered = enumerate((line.split("#", 1)[0].split() for line in text.splitlines()), start=1)
    lines = [(number, words) for number, words in numbered if words]
    num_vertices, num_faces, lines = _counts(path, lines)
    if len(lines) < num_vertices + num_faces:
        raise InputError(
            f"{path}: truncated, its header promises {num_vertices} vertices and {num_faces} faces, "
            f"{len(lines)} lines follow"
        )
    vertices = _vertices(path, lines[:num_vertices])
    return vertices, _triangles(path, lines[num_vertices : num_vertices + num_faces], num_vertices)


def _counts(path: Path, lines: Lines) -> tuple[int, int, Lines]:
    """Return the numbers of vertices and faces, and the lines after the header."""
    first = lines[0][1] if lines else [""]
    if re.fullmatch(r"(ST)?C?N?OFF", first[0]) is None:
        raise InputError(f"{path}: not an OFF file of three dimensions, its first word is not OFF")
    counts, rest = (first[1:], lines[1:]) if len(first) > 1 else (lines[1][1] if len(lines) > 1 else [], lines[2:])
    if len(counts) < 2 or not all(word.isdecimal() for word in counts[:2]):
        raise InputError(f"{path}: its OFF header holds no counts of vertices and faces")
    return int(counts[0]), int(counts[1]), rest


def _vertices(path: Path, lines: Lines) -> FloatArray:
    try:
        return np.array([words[:3] for _, words in lines], dtype=np.float64).reshape(-1, 3)
    except ValueError:
        number, words = next((n, w) for n, w in lines if not _are_numbers(w[:3]))
        raise InputError(f"{path}: line {number} is no vertex of three numbers: {' '.join(words)[:60]!r}") from None


def _triangles(path: Path, lines: Lines, num_vertices: int) -> IntArray:
    triangles: list[list[int]] = []
    for number, words in lines:
        if not words[0].isdecimal() or len(words) <= int(words[0]):
            raise InputError(f"{path}: line {number} is no face: {' '.join(words)[:60]!r} (truncated?)")
        corners = words[1 : 1 + int(words[0])]
        if not all(word.isdecimal() and int(word) < num_vertices for word in corners):
            found = " ".join(corners)[:60]
            raise InputError(f"{path}: line {number}: face {found} has an index outside of 0 to {num_vertices - 1}")
        polygon = [int(word) for word in corners]
        triangles.extend([polygon[0], b, c] for b, c in pairwise(polygon[1:]))
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _are_numbers(words: list[str]) -> bool:
    try:
        return len([float(word) for word in words]) == 3
    except ValueError:
        return False
