"""Coordinate systems of medical images, in which 3D Slicer keeps meshes and landmarks."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np

from data_tools.arrays import read_only
from data_tools.errors import UnavailableError
from data_tools.io.listing import parts_of
from data_tools.io.source import Origin, read_start

#: Where x and y grow: to the left and posterior, or to the right and anterior; z grows to superior in both.
CoordinateSystem = Literal["LPS", "RAS"]
#: Takes coordinates of either system to the other.
LPS_RAS = read_only(np.array([-1.0, -1.0, 1.0]))
_HEADER_BYTES = 1000


def declared_system(file: Origin) -> CoordinateSystem | None:
    """Return the system that a mesh file declares in its header as 3D Slicer does (``SPACE=RAS``).

    None where it, or the first of several parts, declares none, as most do, or is not there any more: 3D Slicer takes
    those as LPS.
    """
    try:
        first = next(iter(parts_of(file).values()), file)
        found = re.search(rb"SPACE=(LPS|RAS)\b", read_start(first, _HEADER_BYTES))
    except UnavailableError:
        return None
    return None if found is None else "LPS" if found[1] == b"LPS" else "RAS"
