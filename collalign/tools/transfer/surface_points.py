"""Semilandmarks of the whole surface, spread evenly over the mean and carried to every specimen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.tools.transfer.posed_specimens import PosedSpecimens, why_lost
from collalign.tools.transfer.result import CARRIED, NO_COUNTERPART, TransferredLandmarks
from data_tools.arrays import read_only
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from data_tools.landmark_files import SemilandmarkRows
from data_tools.surface.shape import Shape

#: What semilandmarks of the whole surface are called.
SURFACE = "surface"


def with_surface_points(
    carried: TransferredLandmarks, specimens: PosedSpecimens, num: int
) -> TransferredLandmarks:
    """Add evenly spread vertices of the mean, on the surface of every shape.

    Raises
    ------
    InputError
        If the mean has fewer vertices.
    """
    collection, dense = specimens.collection, specimens.dense
    mean = Shape.from_arrays(dense.mean, dense.faces, name="the mean")
    if num > len(mean.vertices):
        raise InputError(
            f"surface_points: the mean has {len(mean.vertices)} vertices, {num} are asked for"
        )
    chosen = farthest_points(mean, num, metric="euclidean")
    places, words = [], []
    for name in collection.names:
        reason = specimens.abstention(name)
        points, lost = np.full((num, 3), np.nan), np.full(num, reason or "")
        if reason is None:
            copies = dense.vertices[specimens.rows[name]][chosen]
            surface = specimens.surface(name)
            lost = why_lost(surface, copies)
            there = np.isfinite(copies).all(axis=1) & (lost == "")
            points[there] = surface.locator.closest(copies[there]).on(surface.vertices)
            points = specimens.in_file(name, points)
        places.append(points)
        why = np.where(lost == "", NO_COUNTERPART, lost)
        words.append(np.where(np.isfinite(points).all(axis=1), CARRIED, why).tolist())
    rows = SemilandmarkRows(
        SURFACE, "patch", tuple(range(len(carried.labels), len(carried.labels) + num))
    )
    nothing = np.full((len(collection.names), num), np.nan)
    left_out = np.full((len(carried.templates), num), np.nan)
    no_place = np.repeat(left_out[..., None], 3, axis=2)
    return replace(
        carried,
        labels=(*carried.labels, *(f"{SURFACE}-{number}" for number in range(1, num + 1))),
        points=read_only(np.concatenate([carried.points, np.stack(places)], axis=1)),
        radii=read_only(np.concatenate([carried.radii, nothing], axis=1)),
        ellipsoids=read_only(
            np.concatenate([carried.ellipsoids, np.full((*nothing.shape, 3, 3), np.nan)], axis=1)
        ),
        status=tuple((*own, *more) for own, more in zip(carried.status, words, strict=True)),
        template_trust=read_only(
            np.concatenate([carried.template_trust, np.zeros_like(left_out)], axis=1)
        ),
        left_out_points=read_only(np.concatenate([carried.left_out_points, no_place], axis=1)),
        left_out_errors=read_only(np.concatenate([carried.left_out_errors, left_out], axis=1)),
        left_out_radii=read_only(np.concatenate([carried.left_out_radii, left_out], axis=1)),
        semilandmarks=(*carried.semilandmarks, rows),
    )
