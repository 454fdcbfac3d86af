"""Meshes of fewer triangles."""

from __future__ import annotations

import fast_simplification
import numpy as np

from data_tools.arrays import FloatArray, IntArray


def decimate(vertices: FloatArray, faces: IntArray, max_faces: int) -> tuple[FloatArray, IntArray]:
    """Return a mesh of at most about ``max_faces`` triangles by quadric decimation (Garland and Heckbert 1997).

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
    max_faces : int

    Returns
    -------
    vertices : ndarray, shape (w, 3)
    faces : ndarray of int, shape (g, 3)
        Some may be degenerate.
    """
    if len(faces) <= max_faces:
        return vertices, faces
    # The thresholds of the library are lengths: without a common unit, millimetres and metres would differ.
    centre, unit = vertices.mean(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    scaled = (vertices - centre) / unit
    small, triangles = fast_simplification.simplify(scaled, faces.astype(np.int32), target_count=max_faces)
    return unit * np.asarray(small, dtype=np.float64) + centre, np.asarray(triangles, dtype=np.int64)
