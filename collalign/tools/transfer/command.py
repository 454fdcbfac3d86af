"""``collalign transfer``: landmarks of a few specimens carried to all others."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import replace as with_changes
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from collalign.console.help import Flag
from collalign.console.interruption import INCOMPLETE, resumable
from collalign.console.messages import add_to_summary, say, say_files, warn
from collalign.engine.run_options import RunOptions
from collalign.landmarks.templates import (
    SemilandmarkRequest,
    read_templates,
    shape_of,
    specimen_among,
)
from collalign.output.loading import load
from collalign.tools.export.run import FORMATS, Space, export_notes, usual_space
from collalign.tools.export.run import export as write_export
from collalign.tools.transfer.files import landmarks_page, left_out_summary, write_transfer
from collalign.tools.transfer.run import TransferredLandmarks, transfer_landmarks
from collalign.wording import note_records, note_text
from data_tools.errors import InputError
from data_tools.io.source import refuse_overlap
from data_tools.landmarks.landmark_tables import READABLE


@dataclass(frozen=True, kw_only=True)
class Written:
    """What is written, and how.

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
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
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
    beside = (*semilandmarks.curves, *semilandmarks.patches)
    refuse_overlap(
        written.to, {*collection.inputs, *(shape_of(path)[1] for path in (*landmarks, *beside))}
    )
    given = read_templates(landmarks, collection.names)
    if (
        written.leave_one_out
        and len({*given, *(specimen_among(one, collection.names) for one in beside)}) < 2
    ):
        raise InputError(
            "--leave-one-out: one specimen cannot be predicted from others; give landmarks of two at least"
        )
    with resumable(run, result) as run:
        found = transfer_landmarks(collection, given, semilandmarks=semilandmarks, run=run)
    page = landmarks_page(collection, found, result, written.to)
    collection = with_changes(
        collection, landmarks=found.points, landmark_names=found.labels, pairs=()
    )
    space = usual_space(written.format, "raw") if written.space is None else written.space
    paths = write_export(
        collection,
        written.format,
        written.to,
        space=space,
        semilandmarks=found.semilandmarks,
        system=found.system,
        include_doubtful=written.include_doubtful,
    )
    for note in export_notes(
        collection, written.format, space, include_doubtful=written.include_doubtful
    ):
        warn(note_text(note))
    say_files(
        (*paths, *write_transfer(found, written.to, page=page, leave_one_out=written.leave_one_out))
    )
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
