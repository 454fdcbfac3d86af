"""Nearest-neighbour classification of labelled shapes, each left out once, by the distances of posed surfaces."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from collalign.analysis.label_table import known_label
from collalign.analysis.procrustes import unit_size
from collalign.output.collection import Collection
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread
from pairwise.dense import DensePoints
from pairwise.surface_fit import fit_surfaces

#: Points of each shape. Even points make closest points a measure of the surfaces alone.
NUM_CLOUD_POINTS = 400
#: Neighbours of each shape, by the poses as they are, whose distances are measured after refining the pose: a nearest
#: neighbour is one of these.
NUM_NEAR_SHAPES = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Classification:
    """Leave-one-out nearest-neighbour classification.

    Attributes
    ----------
    names, labels : tuple of str
        Of all shapes; unknown labels are ``""``.
    nearest : ndarray of int, shape (N,)
        Nearest labelled shape of each labelled one, -1 for the others.
    scored, right : ndarray of bool, shape (N,)
        Shapes whose label another shape has as well, and those whose nearest neighbour has it.
    by_label : dict of str to (int, int)
        Scored and right shapes per label.
    chance : float
        Expected accuracy of a random neighbour among the labelled shapes.
    """

    names: tuple[str, ...]
    labels: tuple[str, ...]
    nearest: IntArray
    scored: BoolArray
    right: BoolArray
    by_label: dict[str, tuple[int, int]]
    chance: float

    @property
    def num_scored(self) -> int:
        """The number of shapes that are scored."""
        return int(self.scored.sum())

    @property
    def num_correct(self) -> int:
        """The number of shapes that are right."""
        return int(self.right.sum())

    @property
    def accuracy(self) -> float:
        """The share of scored shapes that are right; NaN if nothing was scored."""
        return self.num_correct / self.num_scored if self.num_scored else float("nan")

    @property
    def single_members(self) -> tuple[str, ...]:
        """Labels that only one shape carries."""
        return tuple(label for label, (num, _) in self.by_label.items() if not num)

    @property
    def statement(self) -> str:
        """How unknown labels and single members were treated, for the methods section."""
        return (
            "Leave-one-out classification by the nearest neighbour. "
            f"{self.labels.count('')} shapes without a label were neither scored nor neighbours; "
            f"{len(self.single_members)} shapes that are the only member of their label were not scored (they can "
            "never be right) but kept as neighbours."
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the result in JSON types, with every wrongly classified shape."""
        wrong = np.flatnonzero(self.scored & ~self.right).tolist()
        names, labels = (*self.names, None), (*self.labels, None)  # where nothing is near
        return {
            "accuracy": self.accuracy if self.num_scored else None,
            "correct": self.num_correct,
            "scored": self.num_scored,
            "chance": self.chance if self.num_scored else None,
            "by_label": {
                label: {"scored": n, "correct": c} for label, (n, c) in self.by_label.items()
            },
            "single_members": list(self.single_members),
            "statement": self.statement,
            "wrong": [
                {
                    "shape": names[at],
                    "label": labels[at],
                    "nearest": names[self.nearest[at]],
                    "predicted": labels[self.nearest[at]],
                }
                for at in wrong
            ],
        }

    def table(self) -> str:
        """Return the result as plain text, one line per label."""
        width = max([len(label) for label in self.by_label], default=5)
        lines = [f"{'label':<{width}}  shapes  correct"]
        lines += [f"{label:<{width}}  {n:>6}  {c:>7}" for label, (n, c) in self.by_label.items()]
        share = f"{100 * self.accuracy:.1f} %" if self.num_scored else "not defined"
        lines += [
            "",
            f"accuracy {share} ({self.num_correct} of {self.num_scored}; chance {100 * self.chance:.1f} %)",
        ]
        return "\n".join([*lines, self.statement])


def classify_leave_one_out(
    distances: ArrayLike, labels: Sequence[str], *, names: Sequence[str] | None = None
) -> Classification:
    """Give every labelled shape the label of its nearest labelled neighbour and count how often that is right.

    A label that only one shape carries cannot be found again when that shape is left out. Such shapes are not scored,
    but remain neighbours of the others, who lose by them.

    Parameters
    ----------
    distances : array_like, shape (N, N)
        Symmetric, for instance :func:`collalign.analysis.procrustes.procrustes_distances`; NaN where there is none.
    labels : sequence of str, length N
        ``""`` (or ``NA`` and the like) where unknown; such shapes are neither scored nor neighbours.
    names : sequence of str, optional

    Returns
    -------
    Classification

    Raises
    ------
    InputError
        If sizes differ or fewer than two shapes are labelled.

    Notes
    -----
    Ties go to the shape that comes first.
    """
    matrix = np.array(distances, dtype=np.float64)
    values = tuple(known_label(label) for label in labels)
    num = len(values)
    if matrix.shape != (num, num):
        raise InputError(
            f"distances: expected shape ({num}, {num}) for {num} labels, got {matrix.shape}"
        )
    kinds, kind_of, counts = np.unique(
        np.array(values, dtype=str), return_inverse=True, return_counts=True
    )
    known = np.array([bool(value) for value in values])
    if known.sum() < 2:
        raise InputError(f"labels: {known.sum()} shapes have a label, at least two are needed")
    matrix[np.isnan(matrix) | ~known | np.eye(num, dtype=bool)] = np.inf
    nearest = np.where(known & np.isfinite(matrix).any(axis=1), matrix.argmin(axis=1), -1)
    alike = counts[kind_of] - 1
    scored = known & (alike > 0)
    right = scored & (nearest >= 0) & (kind_of[nearest] == kind_of)
    return Classification(
        names=tuple(names) if names is not None else tuple(map(str, range(num))),
        labels=values,
        nearest=read_only(nearest),
        scored=read_only(scored),
        right=read_only(right),
        by_label={
            kind: (int(scored[kind_of == at].sum()), int(right[kind_of == at].sum()))
            for at, kind in enumerate(kinds.tolist())
            if kind
        },
        chance=float(alike[scored].mean() / (known.sum() - 1)) if scored.any() else 0.0,
    )


@one_blas_thread()
def surface_distances(
    clouds: Sequence[FloatArray], part_numbers: IntArray, *, num_near: int = NUM_NEAR_SHAPES
) -> FloatArray:
    """Return the closest-point distances of all pairs, shape (N, N); NaN between shapes of different part_numbers.

    A distance is the root mean square of the distances of each point to the nearest of the other shape, both ways, at
    the poses as they are. Pairs of near neighbours are rotated, shifted and scaled to fit best first.

    Parameters
    ----------
    clouds : sequence of ndarray, each (k, 3)
        Evenly spread points of each surface at its pose, centred and of unit centroid size.
    part_numbers : ndarray of int, shape (N,)
        Shapes of different part_numbers are not aligned with each other.
    num_near : int

    Notes
    -----
    Root mean square distances of corresponding points classify molars as well, and need two registrations of every
    shape (``python -m experiments classification``).
    """
    distances = distances_at_poses(clouds)
    distances[part_numbers[:, None] != part_numbers] = np.nan
    points = [DensePoints.from_user(cloud) for cloud in clouds]
    for i, j in near_pairs(distances, num_near):
        distances[i, j] = distances[j, i] = refined_distance(points[i], points[j], np.eye(3))[0]
    return distances


def distances_at_poses(clouds: Sequence[FloatArray]) -> FloatArray:
    """Return the closest-point distances of all pairs as they stand, in parts of the radius, shape (N, N)."""
    trees = [scipy.spatial.cKDTree(cloud) for cloud in clouds]
    distances = np.zeros((len(clouds), len(clouds)))
    for i, j in itertools.combinations(range(len(clouds)), 2):
        squares = [trees[i].query(clouds[j])[0] ** 2, trees[j].query(clouds[i])[0] ** 2]
        num = 0.5 * (len(clouds[i]) + len(clouds[j]))
        distances[i, j] = distances[j, i] = np.sqrt(np.concatenate(squares).mean() * num)
    return distances


def posed_clouds(collection: Collection) -> list[FloatArray]:
    """Return farthest points of every display mesh, centred and of unit size in the common frame, each (k, 3)."""
    clouds = []
    for (vertices, _), rotation in zip(collection.surfaces, collection.rotations, strict=True):
        shape = Shape.from_arrays(vertices)
        chosen = farthest_points(shape, min(NUM_CLOUD_POINTS, len(vertices)), metric="euclidean")
        clouds.append(unit_size(vertices[None, chosen])[0] @ rotation.T)
    return clouds


def near_pairs(distances: FloatArray, num: int) -> list[tuple[int, int]]:
    """Return the pairs (i < j) of which one is among the ``num`` nearest of the other, by distances (N, N)."""
    away = np.where(np.isnan(distances) | np.eye(len(distances), dtype=bool), np.inf, distances)
    nearest = np.argsort(away, axis=1, kind="stable")[:, :num]
    pairs = {
        (min(i, j), max(i, j))
        for i, row in enumerate(nearest.tolist())
        for j in row
        if np.isfinite(away[i, j])
    }
    return sorted(pairs)


def refined_distance(
    target: DensePoints, source: DensePoints, rotation: FloatArray
) -> tuple[float, FloatArray]:
    """Refine a pose by closest points, both ways, with shift and scale.

    Returns
    -------
    distance : float
        Root mean square of the distances of closest points, in parts of the root mean square radius and in the units
        of the geometric mean of both sizes, so that target and source may be exchanged.
    rotation : ndarray, shape (3, 3)
        The refined ``R_target_source``.
    """
    refined = fit_surfaces(target, source, rotation)
    return float(
        np.sqrt(refined.energy / refined.pose.scale)
    ) / target.radius, refined.pose.rotation
