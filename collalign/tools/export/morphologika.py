"""Morphologika landmark files, read by morphologika, geomorph (``read.morphologika``), MorphoJ and EVAN Toolbox."""

from __future__ import annotations

from pathlib import Path

from collalign.tools.export.request import ExportRequest, words
from collalign.tools.export.specimen_names import for_morphologika, specimen_table, without_blanks, written_names


def write(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``landmarks.morphologika.txt`` and ``specimens.csv``; missing landmarks are NaN.

    Labels become the sections ``[labels]`` and ``[labelvalues]``, blanks in them underscores, unknown ones NA.
    """
    landmarks, coordinates = request.landmarks()
    names = written_names(request.collection.names, for_morphologika)
    lines = ["[individuals]", str(len(names)), "[landmarks]", str(len(landmarks)), "[dimensions]", "3"]
    lines += ["[names]", *names]
    columns = request.collection.labels
    if columns:
        lines += ["[labels]", " ".join(without_blanks(column) for column in columns), "[labelvalues]"]
        for values in zip(*columns.values(), strict=True):
            lines.append(" ".join(for_morphologika(value) if value else "NA" for value in values))
    lines.append("[rawpoints]")
    for name, points in zip(names, coordinates, strict=True):
        lines += [f"'{name}", *(words(point) for point in points)]
    path = request.write("landmarks.morphologika.txt", "\n".join(lines) + "\n")
    return path, specimen_table(request, names)
