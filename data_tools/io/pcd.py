"""The Point Cloud Library's PCD format, by Open3D."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError, UnavailableError
from data_tools.io.source import Source

#: No packing makes points smaller than a byte for so many of them: Open3D takes memory for as many as are promised.
_MOST_PER_BYTE = 300


def read_pcd(source: Source) -> tuple[FloatArray, IntArray]:
    """Return the points of a PCD file; other fields are ignored, as are points without a return (NaN).

    Raises
    ------
    UnavailableError
        If Open3D is not installed.
    InputError
        If it reads no points.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise UnavailableError(
            f"{source.path}: PCD files are read by Open3D, which cannot be imported ({error}); "
            "install it with: pip install 'collalign[open3d]'"
        ) from error
    promised = re.search(rb"^POINTS\s+(\d{1,18})\s", source.content[:10_000], re.MULTILINE)
    if promised is None or int(promised[1]) > _MOST_PER_BYTE * len(source.content):
        raise InputError(f"{source.path}: not a PCD file, or truncated")
    with tempfile.TemporaryDirectory() as folder:  # Windows opens no file twice
        copy = Path(folder, "copy.pcd")  # of what was read; the file may be another by now
        copy.write_bytes(source.content)
        with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
            cloud = open3d.io.read_point_cloud(copy, remove_nan_points=True)
    points = np.asarray(cloud.points, dtype=np.float64).reshape(-1, 3)
    if not len(points):
        raise InputError(f"{source.path}: Open3D reads no points of it")
    return points, np.empty((0, 3), dtype=np.int64)
