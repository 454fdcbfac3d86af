"""Tables and the plot of a transfer of landmarks."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collalign.confidence.radius_model import COVERAGE
from collalign.landmarks.curves import slider_rows
from collalign.tools.transfer.result import TransferredLandmarks
from data_tools.io.csv_cells import csv_text
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder

TRANSFER_FILE = "transfer.csv"
LEFT_OUT_FILE, LEFT_OUT_PLOT = "leave_one_out.csv", "leave_one_out.png"
SLIDERS_FILE, SURFACES_FILE = "curveslide.csv", "surfaces.csv"
_WRITER = "transfer"


def write_transfer(transferred: TransferredLandmarks, to: Path, *, leave_one_out: bool) -> tuple[Path, ...]:
    """Write ``transfer.csv``, tables of semilandmarks where there are any, and what leaving out templates showed.

    Parameters
    ----------
    transferred : TransferredLandmarks
    to : Path
    leave_one_out : bool

    Raises
    ------
    InputError
        If the folder cannot be written or files of somebody else's are in the way.
    """
    with OutputFolder.open(to, writer=_WRITER) as output:
        staged = [_write(output.stage(TRANSFER_FILE), transfer_rows(transferred))]
        if transferred.semilandmarks:
            staged.append(_write(output.stage(SLIDERS_FILE), slider_table(transferred)))
            staged.append(_write(output.stage(SURFACES_FILE), surface_table(transferred)))
        if leave_one_out:
            staged.append(_write(output.stage(LEFT_OUT_FILE), left_out_rows(transferred)))
            staged.append(draw_left_out(transferred, output.stage(LEFT_OUT_PLOT)))
        output.publish()
        return tuple(output.published(path) for path in staged)


def transfer_rows(transferred: TransferredLandmarks) -> list[list[object]]:
    """One row per specimen and landmark: place, radius, and what became of it."""
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
    """One row per template and landmark: how far the other templates' answer is from the expert's, and the radius."""
    rows: list[list[object]] = [["name", "landmark", "error", "radius"]]
    for at, name in enumerate(transferred.templates):
        for number, label in enumerate(transferred.labels):
            pair = transferred.left_out_errors[at, number], transferred.left_out_radii[at, number]
            rows.append([name, label, *map(float, pair)])
    return rows


def left_out_summary(transferred: TransferredLandmarks) -> str:
    """How good the transfer is, in one sentence, in the files' units."""
    errors, radius = transferred.left_out_errors, transferred.left_out_radii
    known = np.isfinite(errors)
    said = f"{known.sum()} landmarks of {len(errors)} templates, each predicted from the others: "
    said += f"mean error {errors[known].mean():.4g}, median {np.median(errors[known]):.4g}"
    both = known & np.isfinite(radius)
    if both.any():
        share = 100 * float(np.mean(errors[both] <= radius[both]))
        said += f"; {share:.0f} % within their radius ({100 * COVERAGE:.0f} % meant)"
    return said


def draw_left_out(transferred: TransferredLandmarks, path: Path) -> Path:
    """Draw the errors of every landmark, the worst landmarks first, and the median radius of each."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    errors, radius = transferred.left_out_errors, transferred.left_out_radii
    known = np.isfinite(errors).any(axis=0)
    order = np.flatnonzero(known)[np.argsort(-np.nanmedian(errors[:, known], axis=0), kind="stable")]
    figure = Figure(figsize=(max(5.0, 0.22 * len(order)), 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for place, number in enumerate(order):
        axes.plot(np.full(len(errors), place), errors[:, number], "o", ms=3, color="C0", alpha=0.6)
    if np.isfinite(radius[:, order]).any():
        axes.plot(np.nanmedian(radius[:, order], axis=0), "_", color="C1", ms=9, mew=2, label="radius (median)")
        axes.legend()
    axes.set_xticks(range(len(order)), [transferred.labels[number] for number in order], rotation=90, fontsize=7)
    axes.set_ylabel("error, in the files' unit")
    axes.set_ylim(bottom=0)
    image = io.BytesIO()
    figure.savefig(image, format="png", metadata={"Software": None})
    return write_atomic(path, image.getvalue())


def _write(path: Path, rows: Sequence[Sequence[object]]) -> Path:
    return write_atomic(path, csv_text(rows).encode("utf-8", "backslashreplace"))
