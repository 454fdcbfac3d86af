"""Poses as ITK transform files (``.tfm``), read by 3D Slicer, SimpleITK, ANTs and ITK-SNAP: one file per shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collalign.tools.export.request import ExportRequest, words
from data_tools.io.coordinate_systems import LPS_RAS
from data_tools.io.files import file_stems


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``NAME.tfm`` per shape: the *inverse* of its pose, from the common frame to file coordinates.

    ITK's transforms take points of the fixed (common) space to the moving one, and 3D Slicer inverts them on loading:
    applied there to the original mesh, the file moves it onto the aligned one. In SimpleITK, ``GetInverse()`` is the
    pose. Coordinates are the mesh's own, read as LPS, as Slicer reads meshes, unless its file declares RAS.
    """
    paths = []
    files = zip(file_stems(request.collection.names), request.transforms(), request.file_systems(), strict=True)
    for stem, transform, system in files:
        inverse = np.linalg.inv(transform)
        if system == "RAS":
            inverse[:3] *= LPS_RAS[:, None]
        numbers = [*inverse[:3, :3].ravel(), *inverse[:3, 3]]
        lines = [
            "#Insight Transform File V1.0",
            "#Transform 0",
            "Transform: AffineTransform_double_3_3",
            f"Parameters: {words(numbers)}",
            "FixedParameters: 0 0 0",
        ]
        paths.append(request.write(f"{stem}.tfm", "\n".join(lines) + "\n"))
    return tuple(paths)
