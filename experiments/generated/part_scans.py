"""Scans of a tenth to four tenths of a model's surface, with strays, in random poses, and which poses are right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray
from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import centre_and_radius, spread_over_triangles
from data_tools.local_surface import PART_CELL
from data_tools.poses import moved_by, pose_angle_deg
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.generated.animals import animal
from experiments.generated.assembled import assembled_objects

#: Least and largest share of the surface that a scan shows, stray points per point of it, and noise of its depths.
SHARES, STRAYS, NOISE = (0.1, 0.4), 0.05, 0.003
#: A pose is right within so many degrees and cells, or where it takes so many points of the model onto the model, as
#: near as half a cell: up to the symmetry of the model.
RIGHT_DEG, RIGHT_CELLS, SYMMETRIC = 10.0, 2.0, 0.95


@dataclass(frozen=True, kw_only=True, eq=False)
class PartScan:
    """A scan: its points (n, 3), the last ``num_strays`` of them strays, and its pose on the model, shape (4, 4)."""

    points: FloatArray
    num_strays: int
    pose: FloatArray


def model_of(name: str, seed: int = 0) -> Shape:
    """Return a generated model: a blob, an animal, or an object of a class of ``assembled``."""
    rng = np.random.default_rng([seed, 85])
    if name == "blobs":
        return blob(rng, num_vertices=3000)
    return animal(rng) if name == "animals" else assembled_objects(name, 1, rng)[0]


def part_scans(model: Shape, num: int, rng: np.random.Generator) -> list[PartScan]:
    """Return scans of a model from random directions, each cut off along a random one."""
    centre, radius = centre_and_radius(model)
    surface, _ = spread_over_triangles(model, 0.05 * radius)
    found: list[PartScan] = []
    while len(found) < num:
        view = range_view(model, rng.standard_normal(3), noise=NOISE, rng=rng)
        distances, nearest = cKDTree(view).query(surface)
        heights, is_seen = view @ rng.standard_normal(3), distances < 0.05 * radius
        share = min(1.0, rng.uniform(*SHARES) / is_seen.mean())
        view = view[heights <= np.quantile(heights[nearest[is_seen]], share)]
        if len(view) < 100:
            continue
        num_strays = int(STRAYS * len(view))
        strays = centre + radius * rng.uniform(-1.5, 1.5, (num_strays, 3))
        pose: FloatArray = np.eye(4)
        pose[:3, :3], pose[:3, 3] = random_rotation(rng), radius * rng.standard_normal(3)
        every = np.concatenate([view, strays])
        points = moved_by(np.asarray(np.linalg.inv(pose), dtype=np.float64), every)
        found.append(PartScan(points=points, num_strays=num_strays, pose=pose))
    return found


def is_right(model: Shape, pose: FloatArray, truth: FloatArray) -> bool:
    """Return whether a pose (4, 4) on a model is the true one, up to the model's symmetry."""
    cell = PART_CELL * centre_and_radius(model)[1]
    surface, _ = spread_over_triangles(model, 0.25 * cell)
    few = np.asarray(surface[:: -(-len(surface) // 1500)], dtype=np.float64)
    placed = moved_by(pose @ np.linalg.inv(truth), few)
    off = float(np.linalg.norm(placed - few, axis=1).mean())
    if pose_angle_deg(pose[:3, :3], truth[:3, :3]) < RIGHT_DEG and off < RIGHT_CELLS * cell:
        return True
    return bool((cKDTree(surface).query(placed)[0] < 0.5 * cell).mean() >= SYMMETRIC)
