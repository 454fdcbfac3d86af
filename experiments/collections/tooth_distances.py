"""Cells of the classification: distances of teeth from landmarks, from pairs alone, and at common poses."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from collalign.align import align_collection
from collalign.analysis.procrustes import best_rotations, procrustes_distances
from collalign.engine.records import Record
from collalign.engine.run_options import RunOptions
from collalign.tools.variation.classification import (
    distances_at_poses,
    near_pairs,
    refined_distance,
    surface_distances,
)
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.datasets import Dataset, read_teeth
from experiments.experiment import Cell
from experiments.peers.principal_axes import normalised_points
from pairwise.dense import DensePoints
from pairwise.local_search import minimise
from pairwise.matching import match
from pairwise.options import MatchOptions
from pairwise.problem import Problem

FOLDER = "teeth_pnas116"
NUM_LANDMARKS = 18
#: Dense points that distances are measured on, and those that a pair is matched by on its own.
NUM_DENSE, NUM_PAIR_POINTS = 400, 120
#: Poses of the coarse points that are minimised on all points: so many, up to this multiple of the least energy.
NUM_POSES, POSE_FACTOR = 4, 1.5
_FLIP = np.array([-1.0, 1.0, 1.0])


def measure_landmarks(cell: Cell) -> Record:
    """Return the Procrustes distances of the landmarks, mirrored specimens reflected, and the labels."""
    dataset = read_teeth(cell.data / FOLDER, num_landmarks=cell.settings["landmarks"])
    if dataset.landmarks is None or dataset.chirality is None:
        raise TypeError("the teeth have landmarks and sides")
    mirrored = np.where(
        dataset.chirality[:, None, None] < 0, dataset.landmarks * _FLIP, dataset.landmarks
    )
    labels = {level: list(values) for level, values in dataset.labels.items()}
    return {
        "names": list(dataset.names),
        "labels": labels,
        "distances": procrustes_distances(mirrored),
    }


def measure_poses(cell: Cell) -> Record:
    """Align the files as they are with default options; rotations in the order of the labels."""
    dataset = read_teeth(cell.data / FOLDER)
    with stopwatch() as elapsed:
        aligned = align_collection(cell.data / FOLDER / "meshes", run=RunOptions(jobs=1))
    stems = {
        shape.name: shape.file.stem
        for shape in _shapes(cell.data, len(dataset))
        if shape.file is not None
    }
    position = {name: at for at, name in enumerate(aligned.names)}
    rotations = np.stack([aligned.rotations[position[stems[name]]] for name in dataset.names])
    first, second = np.triu_indices(len(dataset), 1)
    true = np.stack(
        [
            dataset.rotation(i, j, group="O")
            for i, j in zip(first.tolist(), second.tolist(), strict=True)
        ]
    )
    errors = rotation_angle_deg(np.swapaxes(rotations[first], 1, 2) @ rotations[second], true)
    return {
        "rotations": rotations,
        "mirrored": int(np.isnan(errors).sum()),
        "median_deg": float(np.nanmedian(errors)),
        "gross": int((errors > 30).sum()),
        "processor_s": elapsed.processor_s,
    }


def measure_pairs(cell: Cell) -> Record:
    """Match each pair alone with n = k = ``points``, then refine it on the dense points.

    Other settings: ``rows`` (first, last), ``signs`` of the teeth (+1 and -1 for the sides; those without are left
    out), ``coarse`` (see :func:`match_alone`).
    """
    first, last = cell.settings["rows"]
    signs = cell.settings["signs"]
    samples = _samples(cell.data, cell.settings["points"], len(signs))
    points = [
        _unit_size(item.dense_positions * sign_flip(sign))
        for item, sign in zip(samples, signs, strict=True)
    ]
    clouds = [item.positions * sign_flip(sign) for item, sign in zip(samples, signs, strict=True)]
    rows = np.full((3, last - first, len(samples)), np.nan)
    for i in range(first, last):
        for j in range(i + 1, len(samples)):
            pose, matched = match_alone(clouds[i], clouds[j], num_coarse=cell.settings["coarse"])
            closest, pose = refined_distance(points[i], points[j], pose)
            flipped = np.diag(sign_flip(signs[i])) @ pose @ np.diag(sign_flip(signs[j]))
            error_deg = rotation_angle_deg(flipped, _dataset(cell.data).rotation(i, j, group="O"))
            rows[:, i - first, j] = matched, closest, error_deg
    return {"matched": rows[0], "closest": rows[1], "error_deg": rows[2]}


def measure_at_poses(cell: Cell) -> Record:
    """Measure distances at common poses, those of near neighbours with refined poses.

    Settings: ``poses`` (``R_common_shape``) and ``near``: each tooth's pairs with so many neighbours, the nearest by
    closest points at the poses as they are, are refined and matched one to one; a neighbour found is one of these.

    Returns
    -------
    dict
        ``posed`` (one to one, NaN for pairs that are not near) and ``closest``, shapes (N, N).
    """
    poses = np.array(cell.settings["poses"])
    shapes = _shapes(cell.data, len(poses))
    clouds = [
        normalised_points(shape, NUM_DENSE) @ pose.T
        for shape, pose in zip(shapes, poses, strict=True)
    ]
    coarse = distances_at_poses(clouds)
    posed = np.full_like(coarse, np.nan)
    for i, j in near_pairs(coarse, cell.settings["near"]):
        posed[i, j] = posed[j, i] = one_to_one_distance(clouds[i], clouds[j])
    groups = np.zeros(len(clouds), dtype=np.int64)
    return {
        "posed": posed,
        "closest": surface_distances(clouds, groups, num_near=cell.settings["near"]),
    }


def match_alone(
    target: FloatArray, source: FloatArray, *, num_coarse: int
) -> tuple[FloatArray, float]:
    """Match farthest points of unit norm one to one.

    The first points chosen are farthest points as well, only fewer: distinct poses are searched on ``num_coarse`` of
    them, and the best of these are minimised on all points.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
        ``R_target_source``.
    distance : float
        Procrustes distance rho: the energy is ``2 - 2 cos(rho)``.
    """
    few = [points[:num_coarse] - points[:num_coarse].mean(axis=0) for points in (target, source)]
    options = MatchOptions(
        strategy="search", max_candidates=NUM_POSES, candidate_factor=POSE_FACTOR
    )
    poses = match(few[0], few[1], options=options).candidates
    best = minimise(
        Problem.from_user(target, source), np.stack([pose.R_target_source for pose in poses])
    )
    return best.rotations[0], float(2.0 * np.arcsin(min(1.0, np.sqrt(best.energies[0]) / 2.0)))


def one_to_one_distance(target: FloatArray, source: FloatArray) -> float:
    """Return the Procrustes distance rho of centred points of unit norm, matched one to one where they are.

    The match is exact (least sum of squares); the points are then rotated once to fit best. Full and partial
    Procrustes distances, sin(rho) and 2 sin(rho / 2), have the same nearest neighbours.
    """
    rows, columns = linear_sum_assignment(-target @ source.T)
    to, of = target[rows], source[columns]
    cosine = float((to * (of @ best_rotations(to, of).T)).sum())
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def sign_flip(sign: int) -> FloatArray:
    """Return the factors that reflect a specimen of the other side, shape (3,)."""
    return _FLIP if sign < 0 else np.ones(3)


def _unit_size(points: FloatArray) -> DensePoints:
    centred = points - points.mean(axis=0)
    return DensePoints.from_user(centred / np.linalg.norm(centred))


@functools.cache
def _dataset(data: Path) -> Dataset:
    return read_teeth(data / FOLDER)


@functools.cache
def _samples(data: Path, points: int, num: int) -> tuple[Samples, ...]:
    """Return the samples of the first teeth; kept, since every block of rows needs them."""
    sampling = SamplingOptions(num_points=points, num_dense_points=NUM_DENSE)
    return tuple(
        sample_shape(shape, sampling, EmbeddingOptions(kind="xyz")) for shape in _shapes(data, num)
    )


@functools.cache
def _shapes(data: Path, num: int) -> tuple[Shape, ...]:
    return tuple(_dataset(data).shape(which) for which in range(num))
