"""Tables of a transfer of landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collalign.confidence.radius_model import COVERAGE
from collalign.landmarks.curves import slider_rows
from collalign.output.tool_record import write_tool_record
from collalign.tools.transfer.landmarks_page import PAGE_FILE
from collalign.tools.transfer.result import TransferredLandmarks
from data_tools.io.csv_cells import csv_text
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder

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
        See :func:`collalign.tools.transfer.landmarks_page.landmarks_page`.
    leave_one_out : bool

    Raises
    ------
    InputError
        If the folder cannot be written or files of somebody else's are in the way.
    """
    with OutputFolder.open(to, writer=_WRITER) as output:
        staged = [_write(output.stage(TRANSFER_FILE), transfer_rows(transferred))]
        staged.append(write_atomic(output.stage(PAGE_FILE), page.encode("utf-8", "backslashreplace")))
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
    return rows + [[1 + row] for one in transferred.semilandmarks if one.kind == "patch" for row in one.rows]


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
