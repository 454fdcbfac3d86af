"""Fiducial lists of older 3D Slicer versions (``.fcsv``): one file per shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collalign.tools.export.request import ExportRequest, words
from data_tools.io.output_folder import file_stems

_HEADER = """\
# Markups fiducial file version = 4.11
# CoordinateSystem = {system}
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
"""


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``NAME.fcsv`` per shape.

    The format cannot say that a landmark is missing: such landmarks are left out, and the others keep their labels.
    Prefer ``slicer-json`` where landmarks are missing.
    """
    labels, coordinates = request.landmarks()
    paths = []
    stems, systems = file_stems(request.collection.names), request.landmark_systems()
    for stem, points, system in zip(stems, coordinates, systems, strict=True):
        rows = [
            f"{number},{words(point).replace(' ', ',')},0,0,0,1,1,1,0,{label},,"
            for number, (label, point) in enumerate(zip(labels, points, strict=True), start=1)
            if np.isfinite(point).all()
        ]
        paths.append(
            request.write(f"{stem}.fcsv", _HEADER.format(system=system) + "".join(row + "\n" for row in rows))
        )
    return tuple(paths)
