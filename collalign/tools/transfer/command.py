"""``collalign transfer``: landmarks of a few specimens carried to all others."""

from __future__ import annotations

from dataclasses import replace as with_changes
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from collalign.cli.interruption import INCOMPLETE, resumable
from collalign.cli.talk import say, say_files, tell, warn
from collalign.engine.run_options import RunOptions
from collalign.engine.store.layout import STORE_FILE
from collalign.landmarks.templates import read_templates, shape_of
from collalign.output.evidence.loading import load
from collalign.tools.export.run import FORMATS, Space, left_out_sentence
from collalign.tools.export.run import export as write_export
from collalign.tools.transfer.files import left_out_summary, write_transfer
from collalign.tools.transfer.result import TransferredLandmarks
from collalign.tools.transfer.run import transfer_landmarks
from data_tools.errors import InputError
from data_tools.io.output_folder import refuse_overlap
from data_tools.landmarks.landmark_files import specimen_of


def transfer(
    result: Path,
    *,
    landmarks: Annotated[list[Path] | None, Parameter(consume_multiple=True)] = None,
    to: Path,
    curves: Annotated[list[Path] | None, Parameter(consume_multiple=True)] = None,
    patches: Annotated[list[Path] | None, Parameter(consume_multiple=True)] = None,
    curve_points: int | None = None,
    surface_points: int = 0,
    format: Annotated[str, Parameter(help=f"One of {', '.join(FORMATS)}.")] = "slicer-json",
    space: Space = "raw",
    leave_one_out: Annotated[bool, Parameter(negative=())] = False,
    include_doubtful: Annotated[bool, Parameter(negative=())] = False,
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
) -> int:
    """Carry landmarks from the specimens that have them to all others.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote.
    landmarks
        Landmark files (.mrk.json, .fcsv, .csv), each called like the shape it belongs to, or SHAPE=FILE; or those of
        several specimens, by their names (.tps, .nts, morphologika's .txt). Curves become semilandmarks.
    curves
        Files whose points, in their order, are a curve: RIM/A.fcsv is the curve RIM of the shape called A.
    patches
        Files whose points are semilandmarks of a patch of the surface, called likewise.
    curve_points
        Evenly spaced semilandmarks on every curve; by default so many as the first curve has points.
    surface_points
        Semilandmarks spread evenly over the whole surface of every shape.
    to
        Folder for the landmarks of all shapes and transfer.csv with an error radius for each.
    space
        Coordinates: those of the files, the common frame, that in the units of the files, or Procrustes superimposed.
    leave_one_out
        Predict every specimen that has landmarks from the others, and write and print how far off that is.
    include_doubtful
        As in ``collalign export``.
    """
    collection = load(result)
    files = {shape_of(path)[1] for path in (*(landmarks or ()), *(curves or ()), *(patches or ()))}
    refuse_overlap(to, {*collection.inputs, *files})
    given = read_templates(landmarks or (), collection.names)
    if leave_one_out and len({*given, *map(specimen_of, (*(curves or ()), *(patches or ())))}) < 2:
        raise InputError(
            "--leave-one-out: one specimen cannot be predicted from others; give landmarks of two at least"
        )
    store = run.store or result / STORE_FILE
    with resumable(store):
        found = transfer_landmarks(
            result,
            given,
            curves=curves or (),
            patches=patches or (),
            curve_points=curve_points,
            surface_points=surface_points,
            run=with_changes(run, store=store),
        )
    collection = with_changes(collection, landmarks=found.points, landmark_names=found.labels, pairs=())
    paths = write_export(
        collection,
        format,
        to,
        space=space,
        semilandmarks=found.semilandmarks,
        system=found.system,
        include_doubtful=include_doubtful,
    )
    if sentence := left_out_sentence(collection, format, space, include_doubtful=include_doubtful):
        warn(sentence)
    say_files((*paths, *write_transfer(found, to, leave_one_out=leave_one_out)))
    return _summarise(found, leave_one_out=leave_one_out)


def _summarise(found: TransferredLandmarks, *, leave_one_out: bool) -> int:
    """Print what came out and return the exit code."""
    if leave_one_out:
        say(left_out_summary(found))
    for note in found.notes:
        say(f"Note: {note}")
    left_out: dict[str, object] = {}
    missing = np.isnan(found.points).any(axis=2).sum(axis=1)
    for name, count, status in zip(found.names, missing.tolist(), found.status, strict=True):
        if count:
            reasons = sorted({reason for reason in status if reason.startswith(("abstained", "missing"))})
            left_out[name] = {"landmarks": count, "reasons": reasons}
            say(f"{name}: {count} of {len(found.labels)} landmarks left out; {', '.join(reasons)}")
    tell(notes=found.notes, left_out=left_out)
    return INCOMPLETE if missing.any() else 0
