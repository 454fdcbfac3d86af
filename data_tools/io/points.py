"""Point formats: text tables, NPZ archives and, by Open3D, PCD files."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.pcd import read_pcd
from data_tools.io.source import Source
from data_tools.io.text_tables import read_points_table

#: Names of the points in an NPZ archive, the first found is read.
POINT_KEYS = ("vertices", "points", "positions", "xyz")


def read_text_points(source: Source) -> tuple[FloatArray, IntArray]:
    """Return the points of a table of numbers; further columns (colours, normals) are ignored.

    Columns called x, y and z are taken where the first line is a heading, else the first three; see
    :func:`data_tools.io.text_tables.read_points_table` for what is understood and what is refused.
    """
    return read_points_table(source.text("utf-8-sig"), str(source.path)), np.empty((0, 3), dtype=np.int64)


def read_npz(source: Source) -> tuple[FloatArray, IntArray]:
    """Return ``vertices`` (or ``points``, ``positions``, ``xyz``) and ``faces`` if there are any; no pickles."""
    arrays = load_arrays(source.content, str(source.path))
    key = next((k for k in POINT_KEYS if k in arrays), None)
    if key is None:
        raise InputError(f"{source.path}: holds none of the arrays {', '.join(POINT_KEYS)}")
    return arrays[key], arrays.get("faces", np.empty((0, 3), dtype=np.int64))


#: Reader of each suffix.
READERS = {
    ".xyz": read_text_points,
    ".txt": read_text_points,
    ".csv": read_text_points,
    ".npz": read_npz,
    ".pcd": read_pcd,
}
