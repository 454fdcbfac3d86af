"""NTS files as Landmark Editor's DTA variant has them, read by NTSYSpc, geomorph (``readland.nts``) and morphops."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collalign.tools.export.request import ExportRequest, words
from collalign.tools.export.specimen_names import specimen_table, without_blanks, written_names
from data_tools.arrays import FloatArray


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``landmarks.nts`` and ``specimens.csv``; missing landmarks carry the code that the header names."""
    landmarks, coordinates = request.landmarks()
    names = written_names(request.collection.names, without_blanks)
    missing = _missing_code(coordinates)
    lines = [f"1 {len(names)}L {3 * len(landmarks)} 1 {missing} DIM=3", *names]
    lines += [words(point, missing=missing) for points in coordinates for point in points]
    return request.write("landmarks.nts", "\n".join(lines) + "\n"), specimen_table(request, names)


def _missing_code(coordinates: FloatArray) -> str:
    """-9999, or with more nines where coordinates come near it."""
    code = 9999
    while np.nanmax(np.abs(coordinates)) >= code:
        code = 10 * code + 9
    return str(-code)
