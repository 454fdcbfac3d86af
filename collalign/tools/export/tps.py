"""TPS landmark files (Rohlf), read by tpsDig, geomorph (``readland.tps``), Morpho (``readallTPS``) and MorphoJ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from collalign.tools.export.request import ExportRequest, specimen_comment, words
from collalign.tools.export.specimen_names import specimen_table, without_blanks, written_names
from data_tools.arrays import FloatArray


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``landmarks.tps`` and ``specimens.csv``.

    Three-dimensional blocks begin with ``LM3=``; missing landmarks are NaN; there is no SCALE line, because readers
    would multiply by it.
    """
    _, coordinates = request.landmarks()
    names = written_names(request.collection.names, without_blanks)
    comments = [
        specimen_comment(space=request.space, reflected=side) for side in request.collection.reflected.tolist()
    ]
    return request.write("landmarks.tps", tps_text(names, coordinates, comments)), specimen_table(request, names)


def tps_text(names: Sequence[str], coordinates: FloatArray, comments: Sequence[str]) -> str:
    """Return a TPS file of configurations, shape (N, k, 3); names are single words, comments free of "="."""
    lines = []
    for name, points, comment in zip(names, coordinates, comments, strict=True):
        lines += [f"LM3={len(points)}", *(words(point) for point in points), f"ID={name}", f"COMMENT={comment}"]
    return "\n".join(lines) + "\n"
