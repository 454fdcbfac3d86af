"""``collalign transfer``: landmarks of a few specimens carried to all others."""

from __future__ import annotations

import hashlib
import html
import shlex
from dataclasses import dataclass
from dataclasses import replace as with_changes
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from collalign.confidence.radius_model import COVERAGE
from collalign.console.help import Flag
from collalign.console.interruption import INCOMPLETE, resumable
from collalign.console.messages import add_to_summary, say, say_files, warn
from collalign.console.running import Run
from collalign.engine.command_line import json_types
from collalign.engine.run_options import RunOptions
from collalign.output.collection import Collection
from collalign.output.loading import load
from collalign.output.provenance import result_place, write_tool_record
from collalign.output.report.content import shapes_content
from collalign.output.report.page import opener, render_page, shown_part
from collalign.template_landmarks.table import slider_rows
from collalign.template_landmarks.templates import (
    SemilandmarkRequest,
    Slide,
    read_templates,
    shape_of,
    specimen_among,
)
from collalign.tools.export.run import FORMATS, Space, notes_of_export, usual_space
from collalign.tools.export.run import export as write_export
from collalign.tools.transfer.disagreement import (
    agreement_figure,
    agreement_rows,
    agreement_text,
    findings,
)
from collalign.tools.transfer.result import CARRIED, PLACED, TransferredLandmarks
from collalign.tools.transfer.run import transfer_landmarks
from collalign.wording import note_records, note_text
from data_tools.errors import InputError
from data_tools.io.output_folder import OutputFolder, refuse_overlap
from data_tools.io.shapes import declared_system
from data_tools.landmark_tables import READABLE
from data_tools.notes import MAX_NAMED

TRANSFER_FILE = "transfer.csv"
#: What the semi-axes of an ellipsoid are called, the longest first.
AXES = ("along", "across", "normal")
LEAVE_ONE_OUT_FILE = "leave_one_out.csv"
AGREEMENT_TABLE, AGREEMENT_FILE, AGREEMENT_PICTURE = (
    "agreement.csv",
    "agreement.json",
    "agreement.png",
)
SLIDERS_FILE, SURFACES_FILE = "curveslide.csv", "surfaces.csv"
_WRITER = "transfer"


def write_transfer(
    collection: Collection,
    transferred: TransferredLandmarks,
    to: Path,
    *,
    page: str,
    leave_one_out: bool,
    slide: Slide | None = None,
) -> tuple[Path, ...]:
    """Write page and ``transfer.csv``, and tables of semilandmarks where there are any.

    Of several templates, write whether they agree, with a picture where they do not, and what leaving out showed.

    Parameters
    ----------
    collection : Collection
    transferred : TransferredLandmarks
    to : Path
    page : str
        See :func:`collalign.tools.transfer.command.landmarks_page`.
    leave_one_out : bool
    slide : {"bending", "procrustes"}, optional
        How semilandmarks were slid, for the record.

    Raises
    ------
    InputError
        If the folder cannot be written or files of somebody else's are in the way.
    """
    with OutputFolder.open(to, writer=_WRITER) as output:
        staged = [output.stage_table(transfer_rows(transferred), TRANSFER_FILE)]
        staged.append(output.stage_text(page, PAGE_FILE))
        if transferred.semilandmarks:
            staged.append(output.stage_table(slider_table(transferred), SLIDERS_FILE))
            staged.append(output.stage_table(surface_table(transferred), SURFACES_FILE))
        if len(transferred.templates) > 1:
            staged.append(output.stage_table(agreement_rows(transferred), AGREEMENT_TABLE))
            staged.append(output.stage_text(agreement_text(transferred), AGREEMENT_FILE))
        if any(findings(transferred)):
            picture = agreement_figure(collection, transferred)
            staged.append(output.stage_picture(picture, AGREEMENT_PICTURE))
        if leave_one_out:
            staged.append(output.stage_table(left_out_rows(transferred), LEAVE_ONE_OUT_FILE))
        write_tool_record(
            output,
            _WRITER,
            {
                "result": result_place(collection, to),
                "leave_one_out": leave_one_out,
                "slide": slide,
                **transfer_figures(transferred),
            },
        )
        output.publish()
        return tuple(output.published(path) for path in staged)


def transfer_figures(transferred: TransferredLandmarks) -> dict[str, object]:
    """Return what a methods section says of a transfer; lengths in the units of the files, None where unknown."""
    errors, status = transferred.left_out_errors, np.array(transferred.status)
    errors = errors[np.isfinite(errors)]
    carried = status == CARRIED
    radii = transferred.radii[carried & np.isfinite(transferred.radii)]
    is_given = (
        np.isfinite(transferred.template_trust)
        & (status == PLACED)[[transferred.names.index(name) for name in transferred.templates]]
    )
    return {
        "templates": transferred.templates,
        "num_landmarks": len(transferred.labels),
        "num_shapes": len(transferred.names),
        "semilandmarks": [
            {"kind": one.kind, "num": len(one.rows)} for one in transferred.semilandmarks
        ],
        "num_carried": int(carried.sum()),
        "num_lacking": int((~carried & (status != PLACED)).sum()),
        "num_contradicted": int((is_given & (transferred.template_trust <= 0)).sum()),
        "left_out_error": float(errors.mean()) if len(errors) else None,
        "left_out_median": float(np.median(errors)) if len(errors) else None,
        "median_radius": float(np.median(radii)) if len(radii) else None,
    }


def transfer_rows(transferred: TransferredLandmarks) -> list[list[object]]:
    """Return one row per specimen and landmark: place, radius, what became of it, and the ellipsoid's semi-axes."""
    axes = [f"{axis}_{part}" for axis in AXES for part in "xyz"]
    rows: list[list[object]] = [
        ["name", "landmark", "x", "y", "z", "radius", "status", *AXES, *axes]
    ]
    for at, name in enumerate(transferred.names):
        for number, label in enumerate(transferred.labels):
            place = [*transferred.points[at, number].tolist(), float(transferred.radii[at, number])]
            vectors = transferred.ellipsoids[at, number]
            shape = [*np.linalg.norm(vectors, axis=1).tolist(), *vectors.ravel().tolist()]
            rows.append([name, label, *place, transferred.status[at][number], *shape])
    return rows


def slider_table(transferred: TransferredLandmarks) -> list[list[object]]:
    """Return the table of sliders that a transfer writes for geomorph: the neighbours of each, counted from 1."""
    rows: list[list[object]] = [["before", "slide", "after"]]
    for one in transferred.semilandmarks:
        if one.kind != "patch":
            rows += (1 + slider_rows(one.rows, closed=one.kind == "closed curve")).tolist()
    return rows


def surface_table(transferred: TransferredLandmarks) -> list[list[object]]:
    """Return the table of semilandmarks that slide along surfaces, as a transfer writes it, counted from 1."""
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


@dataclass(frozen=True, kw_only=True)
class Written:
    """What a transfer of landmarks writes, and how.

    Parameters
    ----------
    to : Path
        Folder for the landmarks of all shapes, transfer.csv with an error radius for each, and landmarks.html.
    space : {"aligned", "unscaled", "raw", "procrustes"}, optional
        Coordinates of the files (raw), of the common frame (aligned), these in the units of the files (unscaled), or
        Procrustes superimposed. By default unscaled for tps, morphologika and csv, so that sides are alike and sizes
        kept, and raw for the others.
    leave_one_out : bool
        Predict every specimen that has landmarks from the others, and write and print how far off that is.
    include_doubtful : bool
        As in ``collalign export``.
    """

    to: Path
    format: Annotated[str, Parameter(help=f"One of {', '.join(FORMATS)}.")] = "slicer-json"

    space: Space | None = None
    leave_one_out: Flag = False
    include_doubtful: Flag = False


def transfer(
    result: Path,
    *,
    landmarks: Annotated[
        tuple[Path, ...],
        Parameter(
            consume_multiple=True,
            negative=(),
            help=f"Landmark files ({READABLE}), each called like the shape it belongs to, or SHAPE=FILE; or those of "
            "several specimens, by their names (TPS, NTS, morphologika, templates.csv of landmarks.html). Curves "
            "become semilandmarks.",
        ),
    ] = (),
    written: Annotated[Written, Parameter(name="*")],
    semilandmarks: Annotated[
        SemilandmarkRequest, Parameter(name="*", consume_multiple=True, negative=())
    ] = SemilandmarkRequest(),  # noqa: B008
    sources: Path | None = None,
    run: Run = RunOptions(),  # noqa: B008
) -> int:
    """Carry landmarks from the specimens that have them to all others.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote.
    sources
        Folder of the original files where they have moved.
    """
    collection = load(result, sources=sources)
    extra_files = (*semilandmarks.curves, *semilandmarks.patches)
    refuse_overlap(
        written.to,
        {*collection.inputs, *(shape_of(path)[1] for path in (*landmarks, *extra_files))},
    )
    given = read_templates(landmarks, collection.names)
    if (
        written.leave_one_out
        and len({*given, *(specimen_among(one, collection.names) for one in extra_files)}) < 2
    ):
        raise InputError(
            "--leave-one-out: one specimen cannot be predicted from others; give landmarks of two at least"
        )
    with resumable(run, result) as run:
        found = transfer_landmarks(collection, given, semilandmarks=semilandmarks, run=run)
    page = landmarks_page(collection, found, result, written.to)
    marked = with_changes(collection, landmarks=found.points, landmark_names=found.labels, pairs=())
    space = usual_space(written.format, "raw") if written.space is None else written.space
    paths = write_export(
        marked,
        written.format,
        written.to,
        space=space,
        semilandmarks=found.semilandmarks,
        system=found.system,
        include_doubtful=written.include_doubtful,
    )
    for line in notes_of_export(written.to, written.format):
        warn(line)
    tables = write_transfer(
        collection,
        found,
        written.to,
        page=page,
        leave_one_out=written.leave_one_out,
        slide=semilandmarks.slide,
    )
    say_files((*paths, *tables))
    return _summarise(found, leave_one_out=written.leave_one_out)


def _summarise(found: TransferredLandmarks, *, leave_one_out: bool) -> int:
    """Print what came out and return the exit code."""
    if leave_one_out:
        say(left_out_summary(found))
    for note in found.notes:
        say(f"Note: {note_text(note)}")
    left_out: dict[str, object] = {}
    missing = np.isnan(found.points).any(axis=2).sum(axis=1)
    for name, count, status in zip(found.names, missing.tolist(), found.status, strict=True):
        if count:
            reasons = sorted(
                {reason for reason in status if reason.startswith(("abstained", "missing"))}
            )
            left_out[name] = {"landmarks": count, "reasons": reasons}
            say(f"{name}: {count} of {len(found.labels)} landmarks left out; {', '.join(reasons)}")
    add_to_summary(notes=note_records(found.notes), left_out=left_out)
    return INCOMPLETE if missing.any() else 0
