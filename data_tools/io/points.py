"""Point formats: text tables, NPZ archives and PCD."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.pcd import read_pcd
from data_tools.io.source import Source
from data_tools.io.text_tables import parse_table

#: Names of the points in an NPZ archive, the first found is read.
POINT_KEYS = ("vertices", "points", "positions", "xyz")
#: The place of a missing number between separators, or before the first one of a line.
EMPTY_CELL = re.compile(r"(?:^|[,;])[ \t]*(?=[,;])", re.MULTILINE)


def read_text_points(source: Source) -> tuple[FloatArray, IntArray]:
    """Return the points of a table of numbers; further columns (colours, normals) are ignored.

    Columns are separated by blanks, tabs, commas or semicolons; ``#`` and ``//`` start comments. A first line of
    words is a header: columns named x, y and z are taken, else the first three.
    """
    path, text = source.path, source.text("utf-8-sig")
    text = EMPTY_CELL.sub(" nan ", text).replace(",", " ").replace(";", " ")
    stripped = (re.split(r"#|//", line, maxsplit=1)[0].strip() for line in text.splitlines())
    lines = [line for line in stripped if line]
    if not lines:
        raise InputError(f"{path}: holds no points")
    columns = [0, 1, 2]
    if not _is_number(lines[0].split()[0]):
        columns = _header_columns(lines.pop(0).split())
    table = parse_table(lines)
    if table is None or table.shape[1] <= max(columns):
        table = _row_by_row(path, lines, columns)
        columns = [0, 1, 2]
    return np.ascontiguousarray(table[:, columns]), np.empty((0, 3), dtype=np.int64)


def read_npz(source: Source) -> tuple[FloatArray, IntArray]:
    """Return ``vertices`` (or ``points``, ``positions``, ``xyz``) and ``faces`` if there are any; no pickles."""
    arrays = load_arrays(source.content, str(source.path))
    key = next((k for k in POINT_KEYS if k in arrays), None)
    if key is None:
        raise InputError(f"{source.path}: holds none of the arrays {', '.join(POINT_KEYS)}, but {', '.join(arrays)}")
    return arrays[key], arrays.get("faces", np.empty((0, 3), dtype=np.int64))


def _row_by_row(path: Path, lines: list[str], columns: list[int]) -> FloatArray:
    """Return the wanted columns of a table that holds words too, or say which row is wrong."""
    width = len(lines[0].split()) if lines else 0
    points = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if len(words) != width or width <= max(columns):
            expected = max(width, max(columns) + 1)
            raise InputError(f"{path}: row {number} has {len(words)} columns, expected {expected} (truncated?)")
        if not all(_is_number(words[c]) for c in columns):
            raise InputError(f"{path}: row {number} is not numbers: {line[:60]!r}")
        points.append([float(words[c]) for c in columns])
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _header_columns(words: list[str]) -> list[int]:
    names = [word.strip("\"'").lower() for word in words]
    if all(axis in names for axis in "xyz"):
        return [names.index(axis) for axis in "xyz"]
    return [0, 1, 2]


#: Reader of each suffix.
READERS = {
    ".xyz": read_text_points,
    ".txt": read_text_points,
    ".csv": read_text_points,
    ".npz": read_npz,
    ".pcd": read_pcd,
}
