"""Meshes with values at their vertices, as PLY: MeshLab, ParaView, 3D Slicer and R (Rvcg) read the values."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.io.files import write_atomic


def write_scalar_ply(path: Path, vertices: FloatArray, faces: IntArray, scalars: Mapping[str, FloatArray]) -> Path:
    """Write a binary PLY file, atomically.

    Parameters
    ----------
    path : Path
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        May be empty.
    scalars : mapping of str to ndarray, shape (v,)
        Names are single words.
    """
    names = ("x", "y", "z", *scalars)
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {name}" for name in names]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    values = np.column_stack([vertices, *scalars.values()]).astype("<f4")
    triangles = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, faces
    return write_atomic(path, "\n".join(lines).encode("ascii") + values.tobytes() + triangles.tobytes())
