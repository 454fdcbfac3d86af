"""TPS landmark files (Rohlf), read by tpsDig, geomorph (``readland.tps``), Morpho (``readallTPS``) and MorphoJ."""

from __future__ import annotations

from pathlib import Path

from collalign.output.exports.request import ExportRequest, words
from collalign.output.exports.specimen_names import specimen_table, without_blanks, written_names


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``landmarks.tps`` and ``specimens.csv``.

    Three-dimensional blocks begin with ``LM3=``; missing landmarks are NaN; there is no SCALE line, because readers
    would multiply by it.
    """
    landmarks, coordinates = request.landmarks()
    names = written_names(request, without_blanks)
    lines = []
    for name, points in zip(names, coordinates, strict=True):
        lines += [f"LM3={len(landmarks)}", *(words(point) for point in points), f"ID={name}"]
    return request.write("landmarks.tps", "\n".join(lines) + "\n"), specimen_table(request, names)
