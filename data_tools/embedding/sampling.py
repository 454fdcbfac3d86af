"""Farthest point sampling, in the ambient space or along the surface, and samples that a caller gives."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_indices, read_only
from data_tools.errors import InputError, OptionsError
from data_tools.options import MIN_POINTS
from data_tools.surface.geodesics import GeodesicSolver
from data_tools.surface.shape import Shape


def farthest_points(
    shape: Shape,
    num: int,
    *,
    metric: str = "geodesic",
    seeds: ArrayLike | None = None,
    solver: GeodesicSolver | None = None,
) -> IntArray:
    """Choose vertices one by one, each farthest from those chosen before (Gonzalez 1985; Eldar et al. 1997).

    Parameters
    ----------
    shape : Shape
    num : int
        How many.
    metric : {"geodesic", "euclidean"}
        Distance along the surface, or through space.
    seeds : array_like of int, optional
        The first vertices, in order; by default the vertex farthest from the centroid.
    solver : GeodesicSolver, optional
        Of this shape, if there is one already.

    Returns
    -------
    ndarray of int, shape (num,)
        Distinct vertex indices in the order of choice: the first m of them are the m farthest points. Read-only.

    Raises
    ------
    InputError
        If the shape has fewer distinct points than ``num``.
    OptionsError
        If the metric is unknown.
    """
    if num > len(shape.vertices):
        what = "vertices" if shape.is_mesh else "points"
        raise InputError(
            f"{shape.file or shape.name}: {len(shape.vertices)} {what}, {num} samples were asked for"
        )
    distance_from: Callable[[int], FloatArray]
    if metric == "geodesic":
        distance_from = (solver or GeodesicSolver(shape)).from_vertex
    elif metric == "euclidean":
        distance_from = _euclidean(shape.vertices)
    else:
        raise OptionsError(f"metric: expected geodesic or euclidean, got {metric!r}")
    if seeds is None:
        first = np.array([central_extreme(shape.vertices)])
    else:
        first = as_indices(seeds, f"{shape.name}: seeds", upper=len(shape.vertices), shape=(None,))
    return read_only(_choose(distance_from, first[:num], num, shape))


def check_determines_pose(shape: Shape) -> None:
    """Refuse a shape of so few points that they do not determine a pose.

    Raises
    ------
    InputError
    """
    if (num := len(shape.vertices)) < MIN_POINTS:
        raise InputError(
            f"{shape.file or shape.name}: {num} points do not determine a pose; {MIN_POINTS} are needed"
        )


def central_extreme(points: FloatArray) -> int:
    """Return the index of the point, of (n, 3), farthest from the centroid."""
    return int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1)))


def _euclidean(points: FloatArray) -> Callable[[int], FloatArray]:
    coordinates = np.ascontiguousarray(
        points.T
    )  # sums over long rows are several times as fast as over short ones

    def distance_from(index: int) -> FloatArray:
        gaps = coordinates - coordinates[:, index, None]
        return np.sqrt(np.square(gaps, out=gaps).sum(axis=0))

    return distance_from


def _choose(
    distance_from: Callable[[int], FloatArray], seeds: IntArray, num: int, shape: Shape
) -> IntArray:
    chosen = np.empty(num, dtype=np.int64)
    nearest = np.full(len(shape.vertices), np.inf)
    for step in range(num):
        index = int(seeds[step]) if step < len(seeds) else int(np.argmax(nearest))
        if nearest[index] <= 0:
            raise InputError(
                f"{shape.file or shape.name}: only {step} distinct points, {num} samples were asked for"
            )
        chosen[step] = index
        if step + 1 < num:
            np.minimum(nearest, distance_from(index), out=nearest)
            nearest[index] = 0.0
    return chosen


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnPoints:
    """What is given of one shape.

    Attributes
    ----------
    samples : ndarray of int, shape (k,), or None
        Vertices.
    invariants : ndarray, shape (v, m), or None
        Of every vertex.
    weight : float
        Of the invariants, as in :class:`data_tools.options.EmbeddingOptions`.
    """

    samples: IntArray | None
    invariants: FloatArray | None
    weight: float

    @property
    def digest(self) -> str:
        """What the keys of results hold of it."""
        found = hashlib.sha256(repr(self.weight).encode())
        for values in (self.samples, self.invariants):
            found.update(b"-" if values is None else repr(values.shape).encode() + values.tobytes())
        return found.hexdigest()

    def of_shape(self, shape: Shape) -> OwnPoints:
        """Return the same by the vertices of a shape that was read from the file.

        Raises
        ------
        InputError
            If there are not as many rows as vertices, or cleaning removed a sample.
        """
        total, file = len(shape.vertices), shape.file_indices
        invariants, samples = self.invariants, self.samples
        if invariants is not None:
            if len(invariants) != (num := shape.file_size or total):
                raise InputError(
                    f"invariants: {len(invariants)} rows for {num} vertices of the file"
                )
            invariants = invariants[file]
        if samples is not None:
            at = np.searchsorted(file, samples)
            lost = samples[(at == total) | (file[np.minimum(at, total - 1)] != samples)]
            if len(lost):
                raise InputError(
                    f"samples: vertex {lost[0]} is none of the file, or was removed when it was cleaned"
                )
            samples = at
        return replace(self, samples=samples, invariants=invariants)
