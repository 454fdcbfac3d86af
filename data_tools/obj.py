"""Wavefront OBJ, read here because its vertices must keep their order: landmarks and maps name them by number."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError


def read_obj(path: Path) -> tuple[FloatArray, IntArray]:
    """Return the vertices and triangles of an OBJ file; groups are joined, all but ``v`` and ``f`` is ignored.

    Polygons are split into triangles at their first corner. Indices count from 1, or from the end where negative.

    Raises
    ------
    InputError
        If there are no vertices, or a line of either kind is malformed.
    """
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words[:1] == ["v"]:
            vertices.append(_vertex(path, number, words[1:]))
        elif words[:1] == ["f"]:
            polygon = [_corner(path, number, word, len(vertices)) for word in words[1:]]
            if len(polygon) < 3:
                raise InputError(f"{path}: line {number}: a face of {len(polygon)} corners (truncated?)")
            triangles.extend([polygon[0], b, c] for b, c in pairwise(polygon[1:]))
    if not vertices:
        raise InputError(f"{path}: not an OBJ file, it has no vertex lines 'v x y z'")
    faces = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        wrong = int(faces.max()) if faces.max() >= len(vertices) else int(faces.min())
        raise InputError(f"{path}: a face names vertex {wrong + 1}, there are {len(vertices)}")
    return np.array(vertices), faces


def _vertex(path: Path, number: int, words: list[str]) -> list[float]:
    try:
        x, y, z = (float(word) for word in words[:3])
    except ValueError:
        found = " ".join(words)[:60]
        raise InputError(f"{path}: line {number} is no vertex of three numbers: {found!r} (truncated?)") from None
    return [x, y, z]


def _corner(path: Path, number: int, word: str, num_before: int) -> int:
    """Return the index, from 0, of a corner ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``."""
    digits = word.split("/", 1)[0]
    if not digits.removeprefix("-").isdecimal() or int(digits) == 0:
        raise InputError(f"{path}: line {number}: {word[:60]!r} is no corner of a face")
    return int(digits) - 1 if int(digits) > 0 else num_before + int(digits)
