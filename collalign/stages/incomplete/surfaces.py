"""Surfaces of a collection as points with normals and rims, one job per file, each result kept in the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from collalign.engine.jobs.table import SharedTable
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.record_fields import checked
from data_tools.arrays import FloatArray, as_floats, as_points
from data_tools.embedding.surface_points import surface_points
from data_tools.errors import CollectionError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import CleaningOptions
from data_tools.poses import moved_by, scales_of
from pairwise.partial.surface import MOST_POINTS, PartialSurface

#: Changes whenever the same file would give other points.
POINTS_VERSION = "points-1"
_KIND = "surfaces"


@dataclass(frozen=True, kw_only=True)
class PointsTask:
    """What a worker needs to read one surface; a file that has changed since its digest was taken is refused."""

    path: Origin
    name: str
    digest: str
    cleaning: CleaningOptions


def points_of_file(task: PointsTask) -> Record:
    """Read one surface; runs inside a worker."""
    found = surface_points(read_shape(task.path, task.cleaning, name=task.name, digest=task.digest), MOST_POINTS)
    return {
        "points": found.points,
        "normals": found.normals,
        "on_rim": found.on_rim.astype(np.int64),
        "oriented": found.oriented,
    }


def prepare_points(session: AlignSession, shapes: Shapes, chosen: Sequence[int]) -> SharedTable:
    """Return a table of the points of some shapes, by position as text; use it in a ``with`` block.

    Raises
    ------
    CollectionError
        If a file cannot be read any more.
    """
    keys = {i: fingerprint(POINTS_VERSION, {}, shapes.keys[i]) for i in chosen}
    tasks = {
        keys[i]: (
            shapes.names[i],
            PointsTask(
                path=shapes.files[i],
                name=shapes.names[i],
                digest=shapes.digests[i],
                cleaning=session.options.cleaning,
            ),
        )
        for i in chosen
    }
    failures = session.compute(_KIND, points_of_file, tasks, time_limit_s=session.run.shape_time_limit_s)
    if failures:
        raise CollectionError("; ".join(f"{failure.label}: {failure.reason}" for failure in failures.values()))
    return SharedTable.create((str(i), session.store.require(_KIND, keys[i])) for i in chosen)


def posed_points(record: Any, name: str, transform: FloatArray | None = None) -> PartialSurface:
    """Check a record and return the surface, moved where a transform (4, 4) is given.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with checked(f"points of {name}"):
        points = as_points(record["points"], "points", dim=3)
        normals = as_floats(record["normals"], "normals", shape=points.shape)
        on_rim = np.asarray(record["on_rim"]) != 0
        if transform is not None:
            linear = transform[:3, :3]
            points = moved_by(transform, points)
            normals = normals @ linear.T / scales_of(transform)
        return PartialSurface.from_user(points, normals, on_rim, oriented=bool(record["oriented"]))
