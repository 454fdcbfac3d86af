"""Tables and the page of a transfer of landmarks."""

from __future__ import annotations

import hashlib
import html
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collalign.confidence.radius_model import COVERAGE
from collalign.engine.command_line import json_types
from collalign.landmarks.table import slider_rows
from collalign.output.collection import Collection
from collalign.output.provenance import write_tool_record
from collalign.output.report.content import shapes_content
from collalign.output.report.page import opener, render_page, shown_part
from collalign.tools.transfer.run import TransferredLandmarks
from collalign.wording import note_text
from data_tools.io.coordinate_systems import declared_system
from data_tools.io.csv_cells import csv_text
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder
from data_tools.percent import MAX_NAMED

TRANSFER_FILE = "transfer.csv"
LEFT_OUT_FILE = "leave_one_out.csv"
SLIDERS_FILE, SURFACES_FILE = "curveslide.csv", "surfaces.csv"
_WRITER = "transfer"


def write_transfer(
    transferred: TransferredLandmarks, to: Path, *, page: str, leave_one_out: bool
) -> tuple[Path, ...]:
    """Write page and ``transfer.csv``, tables of semilandmarks where there are any, and what leaving out showed.

    Parameters
    ----------
    transferred : TransferredLandmarks
    to : Path
    page : str
        See :func:`collalign.tools.transfer.files.landmarks_page`.
    leave_one_out : bool

    Raises
    ------
    InputError
        If the folder cannot be written or files of somebody else's are in the way.
    """
    with OutputFolder.open(to, writer=_WRITER) as output:
        staged = [_write(output.stage(TRANSFER_FILE), transfer_rows(transferred))]
        staged.append(
            write_atomic(output.stage(PAGE_FILE), page.encode("utf-8", "backslashreplace"))
        )
        if transferred.semilandmarks:
            staged.append(_write(output.stage(SLIDERS_FILE), slider_table(transferred)))
            staged.append(_write(output.stage(SURFACES_FILE), surface_table(transferred)))
        if leave_one_out:
            staged.append(_write(output.stage(LEFT_OUT_FILE), left_out_rows(transferred)))
        decided = {
            "templates": transferred.templates,
            "num_landmarks": len(transferred.labels),
            "num_shapes": len(transferred.names),
            "leave_one_out": leave_one_out,
        }
        write_tool_record(output, _WRITER, decided)
        output.publish()
        return tuple(output.published(path) for path in staged)


def transfer_rows(transferred: TransferredLandmarks) -> list[list[object]]:
    """Return one row per specimen and landmark: place, radius, and what became of it."""
    rows: list[list[object]] = [["name", "landmark", "x", "y", "z", "radius", "status"]]
    for at, name in enumerate(transferred.names):
        for number, label in enumerate(transferred.labels):
            place = [*transferred.points[at, number].tolist(), float(transferred.radii[at, number])]
            rows.append([name, label, *place, transferred.status[at][number]])
    return rows


def slider_table(transferred: TransferredLandmarks) -> list[list[object]]:
    """Return between which landmarks each semilandmark of a curve slides, counted from 1, as geomorph has it."""
    rows: list[list[object]] = [["before", "slide", "after"]]
    for one in transferred.semilandmarks:
        if one.kind != "patch":
            rows += (1 + slider_rows(one.rows, closed=one.kind == "closed curve")).tolist()
    return rows


def surface_table(transferred: TransferredLandmarks) -> list[list[object]]:
    """Return the numbers, from 1, of semilandmarks that slide along surfaces."""
    rows: list[list[object]] = [["surface"]]
    return rows + [
        [1 + row] for one in transferred.semilandmarks if one.kind == "patch" for row in one.rows
    ]


def left_out_rows(transferred: TransferredLandmarks) -> list[list[object]]:
    """Return one row per template and landmark: the error of the other templates' prediction, and its radius."""
    rows: list[list[object]] = [["name", "landmark", "error", "radius"]]
    for at, name in enumerate(transferred.templates):
        for number, label in enumerate(transferred.labels):
            pair = transferred.left_out_errors[at, number], transferred.left_out_radii[at, number]
            rows.append([name, label, *map(float, pair)])
    return rows


def left_out_summary(transferred: TransferredLandmarks) -> str:
    """Say how good the transfer is, in one sentence, in the files' units."""
    errors, radius = transferred.left_out_errors, transferred.left_out_radii
    known = np.isfinite(errors)
    said = f"{known.sum()} landmarks of {len(errors)} templates, each predicted from the others: "
    said += f"mean error {errors[known].mean():.4g}, median {np.median(errors[known]):.4g}"
    both = known & np.isfinite(radius)
    if both.any():
        share = 100 * float(np.mean(errors[both] <= radius[both]))
        said += f"; {share:.0f} % within their radius ({100 * COVERAGE:.0f} % is the goal)"
    return said


def _write(path: Path, rows: Sequence[Sequence[object]]) -> Path:
    return write_atomic(path, csv_text(rows).encode("utf-8", "backslashreplace"))


PAGE_FILE = "landmarks.html"


def landmarks_page(
    collection: Collection, found: TransferredLandmarks, result: Path, to: Path
) -> str:
    """Return the page as HTML text, with the command of the next transfer from ``result`` into ``to``.

    Of a large collection it shows the shapes that the report shows; curves and patches are left to what slides them.
    """
    shown = shown_part(collection)
    document, blobs = shapes_content(shown)
    rows = [collection.index(name) for name in shown.names]
    along = {row for one in found.semilandmarks for row in one.rows}
    chosen = [row for row in range(len(found.labels)) if row not in along]
    words = ["collalign", "transfer", str(result), "--landmarks", "templates.csv", "--to", str(to)]
    document["kind"] = "landmarks"
    document["run"] += hashlib.sha256(np.nan_to_num(found.points).tobytes()).hexdigest()[:16]
    document["landmarks"] = {
        "labels": [found.labels[row] for row in chosen],
        "points": found.points[np.ix_(rows, chosen)],
        "radii": found.radii[np.ix_(rows, chosen)],
        "status": [[found.status[at][row] for row in chosen] for at in rows],
        "systems": [
            (declared_system(Path(file)) if file else None) or found.system for file in shown.files
        ],
        "command": shlex.join(words),
    }
    lacking = np.isnan(found.points[:, chosen]).any(axis=2).sum(axis=1)
    doubted = np.argsort(-lacking, kind="stable")[: int((lacking > 0).sum())]
    named = ", ".join(
        opener(found.names[at]) for at in doubted[:MAX_NAMED] if found.names[at] in shown.names
    )
    said = f"{len(found.names) - len(doubted)} of {len(found.names)} specimens have all {len(chosen)} landmarks."
    summary = f'<p class="verdict {"warn" if named else "plain"}">{said}{f" Look at: {named}." if named else ""}</p>'
    notes = dict.fromkeys(map(note_text, (*found.notes, *collection.notes)))
    items = "".join(f"<li>{html.escape(note)}</li>" for note in notes)
    summary += f'<ul class="notes">{items}</ul>' if items else ""
    version = str(collection.run.versions.get("collalign", ""))
    return render_page("Landmarks", summary, dict(json_types(document)), blobs, version=version)
