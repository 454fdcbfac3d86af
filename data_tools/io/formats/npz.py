"""Points and triangles of NumPy's archives, under one of the usual names."""

from __future__ import annotations

from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.formats.raw_shape import RawShape, no_faces
from data_tools.io.source import Source

#: Names of the points in an NPZ archive of a shape, the first found is read.
POINT_KEYS = ("vertices", "points", "positions", "xyz", "verts", "V")
#: Likewise of the triangles.
FACE_KEYS = ("faces", "triangles", "F")


def read_npz(source: Source) -> RawShape:
    """Return the first array of :data:`POINT_KEYS`, and of :data:`FACE_KEYS` if there are any; no pickles."""
    arrays = load_arrays(source.content, str(source.path))
    key = next((k for k in POINT_KEYS if k in arrays), None)
    if key is None:
        raise InputError(f"{source.path}: holds none of the arrays {', '.join(POINT_KEYS)}")
    return RawShape(arrays[key], next((arrays[k] for k in FACE_KEYS if k in arrays), no_faces()))
