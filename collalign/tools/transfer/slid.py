"""Semilandmarks of a transfer, slid towards the mean of all specimens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.analysis.sliding import Criterion, slide_semilandmarks
from collalign.output.collection import Collection
from collalign.template_landmarks.table import slider_rows
from collalign.tools.transfer.result import TransferredLandmarks
from data_tools.arrays import read_only
from data_tools.errors import InputError
from data_tools.notes import Note
from data_tools.poses import each_moved_by


def with_slid(
    found: TransferredLandmarks, collection: Collection, criterion: Criterion
) -> TransferredLandmarks:
    """Return landmarks with semilandmarks slid along curves and surfaces.

    Specimens of which landmarks are missing stay as they are, with a note.

    Parameters
    ----------
    found : TransferredLandmarks
    collection : Collection
    criterion : {"bending", "procrustes"}

    Raises
    ------
    InputError
        If there are no semilandmarks, or fewer than two specimens with all landmarks.
    """
    if not found.semilandmarks:
        raise InputError(
            "slide: there are no semilandmarks; give curves, patches or surface_points"
        )
    complete = np.asarray(np.isfinite(found.points).all(axis=(1, 2)))
    if complete.sum() < 2:
        raise InputError("slide: fewer than two specimens have all landmarks")
    curves = [one for one in found.semilandmarks if one.kind != "patch"]
    sliders = [slider_rows(one.rows, closed=one.kind == "closed curve") for one in curves]
    patches = [row for one in found.semilandmarks if one.kind == "patch" for row in one.rows]
    poses, points = collection.transforms[complete], np.array(found.points)
    slid = slide_semilandmarks(
        each_moved_by(poses, points[complete]),
        np.concatenate([np.empty((0, 3), dtype=np.int64), *sliders]),
        patches,
        criterion=criterion,
    )
    points[complete] = each_moved_by(np.linalg.inv(poses).astype(np.float64), slid)
    left = tuple(name for name, slides in zip(found.names, complete, strict=True) if not slides)
    notes = (Note("not-slid", left),) if left else ()
    return replace(found, points=read_only(points), notes=(*found.notes, *notes))
