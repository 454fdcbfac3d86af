"""Other ways to carry landmarks from one posed surface to another, with the packages they need."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collalign.engine.records import Record
from data_tools.arrays import FloatArray
from data_tools.embedding.sampling import farthest_points
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.carrying import moved, on_shape, scale_of, write_posed
from experiments.experiment import Cell
from experiments.importable import is_importable

#: Farthest points of each surface that coherent point drift sees.
NUM_CLOUD = 1500
#: Nearest cloud points that carry a landmark along.
_NUM_CARRIERS = 4

#: Takes target, source and points on the source to where these are on the target, all in one frame.
Carrier = Callable[[Shape, Shape, FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class Warp:
    """A way to carry landmarks.

    Attributes
    ----------
    carry : callable
    package : str
        What has to be installed; empty for nothing.
    own_start : bool
        Whether it finds the pose itself, from the files' random ones.
    """

    carry: Carrier
    package: str = ""
    own_start: bool = False

    @property
    def lacks(self) -> bool:
        """Whether its package cannot be imported."""
        return bool(self.package) and not is_importable(self.package)


def _closest(target: Shape, source: Shape, points: FloatArray) -> FloatArray:
    return on_shape(target, points)


def _drift(target: Shape, source: Shape, points: FloatArray) -> FloatArray:
    """Deformable coherent point drift of rustcpd with its default options, in normalised coordinates."""
    import rustcpd

    clouds = [_cloud(shape) for shape in (target, source)]
    found = rustcpd.register_deformable(clouds[0], clouds[1], normalize=True, parallel=False)
    return on_shape(target, _carried_along(points, clouds[1], np.asarray(found.points)))


def _drift_from_own_start(target: Shape, source: Shape, points: FloatArray) -> FloatArray:
    """Rigid, then deformable coherent point drift."""
    import rustcpd

    found = rustcpd.register_rigid(_cloud(target), _cloud(source), normalize=True, parallel=False)
    start, along = (
        np.asarray(
            found.scale * points @ np.asarray(found.rotation) + np.asarray(found.translation)
        )
        for points in (source.vertices, points)
    )
    return _drift(target, Shape.from_arrays(start, source.faces), along)


WARPS: dict[str, Warp] = {
    "closest points at the toolkit's poses": Warp(carry=_closest),
    "coherent point drift at the toolkit's poses (rustcpd)": Warp(carry=_drift, package="rustcpd"),
    "rigid, then deformable drift from the files (rustcpd)": Warp(
        carry=_drift_from_own_start, package="rustcpd", own_start=True
    ),
}


def _cloud(shape: Shape) -> FloatArray:
    chosen = farthest_points(shape, min(NUM_CLOUD, len(shape.vertices)), metric="euclidean")
    return np.ascontiguousarray(shape.vertices[chosen])


def _carried_along(points: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Move points with the nearest of a cloud, by inverse distance."""
    gaps = np.linalg.norm(points[:, None] - before[None], axis=2)
    nearest = np.argsort(gaps, axis=1, kind="stable")[:, :_NUM_CARRIERS]
    weights = 1.0 / np.maximum(
        np.take_along_axis(gaps, nearest, axis=1), 1e-9 * float(np.ptp(before))
    )
    weights /= weights.sum(axis=1, keepdims=True)
    return points + np.einsum("pc,pcd->pd", weights, (after - before)[nearest])


def measure_warp(cell: Cell) -> Record:
    """Carry landmarks between some pairs of a collection; the poses are those that the toolkit found.

    Returns
    -------
    dict
        ``errors`` (pairs, l) in the collection's unit; ``processor_s`` per pair.
    """
    settings = cell.settings
    warp, transforms = WARPS[settings["way"]], np.array(settings["transforms"])
    with tempfile.TemporaryDirectory() as scratch:
        posed = write_posed(cell, Path(scratch))
        errors, seconds = [], []
        for i, j in settings["pairs"]:
            T_j = transforms[j]
            if warp.own_start:  # the side, where it is mirrored, and nothing else
                mirror = np.diag(
                    [np.sign(np.linalg.det(transforms[i, :3, :3] @ T_j[:3, :3])), 1.0, 1.0, 1.0]
                )
                frames = np.eye(4), mirror
            else:
                frames = transforms[i], T_j
            target, source = (
                posed.shape(at).transformed(T) for at, T in zip((i, j), frames, strict=True)
            )
            points = moved(frames[1], posed.landmarks[j])
            with stopwatch() as elapsed:
                found = warp.carry(target, source, points)
            truth = moved(frames[0], posed.landmarks[i])
            errors.append(
                np.linalg.norm(found - truth, axis=1) / (posed.units[i] * scale_of(frames[0]))
            )
            seconds.append(elapsed.processor_s)
    return {"errors": np.array(errors), "processor_s": float(np.mean(seconds))}
