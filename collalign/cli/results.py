"""``collalign export``, ``verify``, ``classify`` and ``view``: what can be done with a finished result."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.analysis.classify import Singles, classify_leave_one_out
from collalign.analysis.label_table import read_labels
from collalign.analysis.surface_distance import surface_distances
from collalign.output.evidence.clouds import posed_clouds
from collalign.output.evidence.file import load_view
from collalign.output.exports import FORMATS, Space
from collalign.output.exports import export as write_export
from collalign.output.verify import verify_result
from data_tools.errors import InputError

#: Said below every classification.
_DISTANCES = "By distances of surfaces: closest points at the poses, refined for near neighbours."


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


def verify(
    result: Path,
    *,
    as_json: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Check every certificate of a result, without trusting the program that made it.

    Parameters
    ----------
    result
        Folder that ``collalign align --certify`` wrote.
    as_json
        Print one JSON object instead of a table.
    """
    found = verify_result(result)
    print(json.dumps(found.as_dict(), indent=1) if as_json else found.table())
    return 0 if found.holds else InputError.exit_code


def classify(
    result: Path,
    *,
    labels: Path,
    by: str,
    singles: Singles = "leave-out",
    as_json: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Classify every shape by its nearest neighbour, leaving it out.

    The distance of two shapes is that of their surfaces, by closest points at their poses, of all pairs of near
    neighbours after turning, shifting and scaling to fit best. On 116 molars points in dense correspondence classify
    no better.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote.
    labels
        CSV file with one row per shape.
    by
        Column of the labels.
    singles
        Whether labels that only one shape carries are left out of the count or count as wrong.
    as_json
        Print one JSON object instead of a table.
    """
    view = load_view(result)
    table = read_labels(labels)
    values = table.column(by, view.names)
    for sentence in table.mismatches(view.names):
        print(f"collalign: {sentence}", file=sys.stderr)
    distances = surface_distances(posed_clouds(view), view.part_numbers)
    found = classify_leave_one_out(distances, values, names=view.names, singles=singles)
    print(json.dumps(found.as_dict(), indent=1) if as_json else f"{found.table()}\n{_DISTANCES}")
    return 0


def view(result: Path, *, overlay: bool = False) -> int:
    """Open a window with the aligned shapes (needs ``pip install 'collalign[viewer]'``).

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote.
    overlay
        All shapes in one place instead of side by side.
    """
    from collalign.output.window import view as open_view

    open_view(result, overlay=overlay)
    return 0
