"""Specimen names as text formats can carry them, and the table that says which shape each stands for."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from collalign.tools.export.request import ExportRequest, label_columns, member_columns, specimen_comment
from data_tools.io.csv_cells import csv_text

#: Section names of morphologika files. Readers search for them anywhere in a line, so no specimen may contain one.
_SECTIONS = (
    "individuals",
    "landmarks",
    "dimensions",
    "names",
    "labels",
    "labelvalues",
    "rawpoints",
    "wireframe",
    "groups",
)


def without_blanks(name: str) -> str:
    """Replace every run of blanks, quotes and brackets by an underscore."""
    return re.sub(r"[\s'\"\[\]]+", "_", name)


def for_morphologika(name: str) -> str:
    """Name without blanks in which no section's name occurs: ``names_1`` becomes ``n-ames_1``."""
    safe = without_blanks(name)
    for section in _SECTIONS:
        safe = re.sub(section, lambda found: f"{found[0][0]}-{found[0][1:]}", safe, flags=re.IGNORECASE)
    return safe


def written_names(names: Iterable[str], rule: Callable[[str], str]) -> list[str]:
    """Return names by a rule, made distinct by a number at the end."""
    taken: set[str] = set()
    written = []
    for name in names:
        safe, number = rule(name), 2
        while safe in taken:
            safe, number = f"{rule(name)}-{number}", number + 1
        taken.add(safe)
        written.append(safe)
    return written


def specimen_table(request: ExportRequest, written: list[str]) -> Path:
    """Write ``specimens.csv``: shape, size, confidence, whether it counts, and labels of every specimen of a file."""
    collection = request.collection
    columns: dict[str, list[Any]] = {
        "name": list(collection.names),
        "id": written,
        "file": list(collection.files),
        "centroid_size": collection.centroid_sizes.tolist(),
        "confidence": collection.confidence.tolist(),
        "reflected": collection.reflected.astype(int).tolist(),
        "coordinates": [
            specimen_comment(space=request.space, reflected=side) for side in collection.reflected.tolist()
        ],
        "group": collection.part_numbers.tolist(),
        **member_columns(request),
    }
    columns |= label_columns(collection, columns)
    return request.write("specimens.csv", csv_text([columns, *zip(*columns.values(), strict=True)]))
