"""``collalign export``: a result in a format of the field."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.console.help import Excluded, Flag
from collalign.console.messages import say_files, warn
from collalign.tools.export.run import FORMATS, Space, notes_of_export
from collalign.tools.export.run import export as write_export


def export(
    result: Path,
    *,
    format: Annotated[str, Parameter(help=f"One of {', '.join(FORMATS)}.")],
    to: Path,
    space: Space | None = None,
    sources: Path | None = None,
    exclude: Excluded = (),
    right: float | None = None,
    include_doubtful: Flag = False,
) -> int:
    """Write a result in a format of the field.

    Meshes are written without colours, texture coordinates and materials.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote.
    to
        Folder for the files.
    space
        Coordinates: aligned, aligned in the units of the files (unscaled), those of the files (raw), or Procrustes
        superimposed. By default unscaled for tps, morphologika, csv and parquet, so that sides are alike and sizes
        kept, and aligned for the others.
    sources
        Folder of the original files where they have moved.
    right
        Write only the surest shapes, as many as let expect this share of right poses: 0.99, for instance. The others
        are in left_out.csv.
    include_doubtful
        Superimpose shapes whose pose is in doubt, and incomplete ones, too.
    """
    paths = write_export(
        result,
        format,
        to,
        space=space,
        sources=sources,
        exclude=exclude,
        right=right,
        include_doubtful=include_doubtful,
    )
    for line in notes_of_export(to, format):
        warn(line)
    say_files(paths)
    return 0
