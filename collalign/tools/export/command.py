"""``collalign export``: a result in a format of the field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.tools.export.run import FORMATS, Space
from collalign.tools.export.run import export as write_export


def export(
    result: Path,
    *,
    format: Annotated[str, Parameter(help=f"One of {', '.join(FORMATS)}.")],
    to: Path,
    space: Space = "aligned",
    sources: Path | None = None,
) -> int:
    """Write a result in a format of the field.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote.
    to
        Folder for the files.
    space
        Coordinates: aligned, aligned in the units of the files, those of the files, or Procrustes superimposed.
    sources
        Folder of the original files where they have moved.
    """
    for path in write_export(result, format, to, space=space, sources=sources):
        print(path)
    return 0
