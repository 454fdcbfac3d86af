"""How wrong a map is: the protocol of Kim, Lipman and Funkhouser (Blended Intrinsic Maps, 2011).

The error of a matched point is the geodesic distance on the target from its image to its true place, divided by the
square root of the target's area. A map is summed up by the mean and by the share of points within each distance. On
symmetric shapes a map may also be compared with the mirrored truth; the better of the two counts, for the whole map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, as_indices, read_only
from data_tools.errors import InputError
from data_tools.surface.geodesics import GeodesicSolver
from data_tools.surface.laplacian import vertex_areas
from data_tools.surface.shape import Shape

#: Errors at which cumulative curves are evaluated.
THRESHOLDS = np.linspace(0.0, 0.25, 251)


@dataclass(frozen=True, kw_only=True, eq=False)
class MapErrors:
    """Errors of one map at the evaluated points, in units of sqrt(area) of the target.

    Attributes
    ----------
    direct : ndarray, shape (s,)
        Against the truth; infinite where a point has no image.
    mirrored : ndarray, shape (s,), or None
        Against the mirrored truth, where it is known.
    """

    direct: FloatArray
    mirrored: FloatArray | None = None

    @property
    def accepting_flips(self) -> FloatArray:
        """The errors against whichever truth the whole map is nearer to."""
        if self.mirrored is None or self.direct.mean() <= self.mirrored.mean():
            return self.direct
        return self.mirrored


class MapEvaluator:
    """Distances on one target from the true places of the evaluated points, computed once for any number of maps.

    Parameters
    ----------
    target : Shape
        As in its file.
    truth : array_like of int, shape (s,)
        True place of each evaluated point, a vertex of the target.
    mirrored_truth : array_like of int, shape (s,), optional
        The place of its mirror image.
    """

    def __init__(
        self, target: Shape, truth: ArrayLike, mirrored_truth: ArrayLike | None = None
    ) -> None:
        num = len(target.vertices)
        self._solver = GeodesicSolver(target)
        self._unit = float(np.sqrt(vertex_areas(target).sum()))
        self._truth = as_indices(truth, "truth", upper=num, shape=(None,))
        self._distances = self._from(self._truth)
        self._to_mirrored: FloatArray | None = None
        if mirrored_truth is not None:
            mirrored = as_indices(
                mirrored_truth, "mirrored_truth", upper=num, shape=(len(self._truth),)
            )
            self._to_mirrored = self._from(mirrored)

    def errors(self, images: ArrayLike) -> MapErrors:
        """Return the errors of a map.

        Parameters
        ----------
        images : array_like of int, shape (s,)
            Vertex of the target to which each evaluated point is mapped, -1 where it has none.
        """
        num = self._distances.shape[1]
        found = as_indices(images, "images", lower=-1, upper=num, shape=(len(self._truth),))
        mirrored = None if self._to_mirrored is None else _look_up(self._to_mirrored, found)
        return MapErrors(direct=_look_up(self._distances, found), mirrored=mirrored)

    def _from(self, vertices: IntArray) -> FloatArray:
        unique, inverse = np.unique(vertices, return_inverse=True)
        distances = np.stack([self._solver.from_vertex(int(v)) for v in unique]) / self._unit
        return distances[inverse.ravel()]


def cumulative_curve(
    errors: Sequence[FloatArray], thresholds: FloatArray = THRESHOLDS
) -> FloatArray:
    """Return the share of all points whose error is at most each threshold, shape (len(thresholds),).

    Raises
    ------
    InputError
        If there are no errors.
    """
    pooled = (
        np.concatenate([np.asarray(e, dtype=np.float64) for e in errors])
        if len(errors)
        else np.empty(0)
    )
    if not len(pooled):
        raise InputError("errors: there are none to draw a curve of")
    return read_only(np.searchsorted(np.sort(pooled), thresholds, side="right") / len(pooled))


def summary(errors: Sequence[FloatArray]) -> dict[str, float]:
    """Return the mean, the share of points within 0.1, and the largest mean and error of any map."""
    means = np.array([e.mean() for e in errors])
    return {
        "num_maps": float(len(errors)),
        "mean": float(means.mean()),
        "median_of_maps": float(np.median(means)),
        "within_0.1": float(cumulative_curve(errors, np.array([0.1]))[0]),
        "worst_map": float(means.max()),
        "worst_point": float(max(e.max() for e in errors)),
    }


def _look_up(distances: FloatArray, images: IntArray) -> FloatArray:
    values = distances[np.arange(len(images)), np.maximum(images, 0)]
    return read_only(np.where(images >= 0, values, np.inf))
