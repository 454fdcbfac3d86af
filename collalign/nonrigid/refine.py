"""Refining maps of samples to maps of dense samples, and those to maps of all vertices."""

from __future__ import annotations

import numpy as np

from collalign.nonrigid.surface import SpectralShape
from data_tools.arrays import FloatArray, IntArray
from pairwise.functional_map import FunctionalMap, ZoomOut, mutual_nearest_rows, zoomout_sizes

#: Root mean square weight of a curvature relative to one eigenfunction in nearest neighbours.
CURVATURE_WEIGHT = 0.3


class Refiner:
    """ZoomOut between the dense samples of two shapes, prepared once for all candidates of the pair.

    Parameters
    ----------
    target, source : SpectralShape
    num_dense : int
        How many of the dense samples are used.
    first, last : int
        Numbers of functions, the constant one included, at the start and the end.
    factor : float
        Growth of the number of functions from step to step.
    """

    def __init__(
        self, target: SpectralShape, source: SpectralShape, *, num_dense: int, first: int, last: int, factor: float
    ) -> None:
        self.on_target, self.on_source = target.dense[:num_dense], source.dense[:num_dense]
        last = min(last, len(target.eigenvalues) + 1, len(source.eigenvalues) + 1)
        self._target, self._source = target.basis[self.on_target], source.basis[self.on_source]
        features = descriptors(target, source)
        if features is not None:
            features = features[0][self.on_target], features[1][self.on_source]
        self._zoomout = ZoomOut(
            self._target,
            self._source,
            zoomout_sizes(min(first, last), last, factor=factor),
            descriptors=features,
            descriptor_weight=CURVATURE_WEIGHT,
        )

    def from_rotation(self, rotation_target_source: FloatArray) -> FunctionalMap:
        """Refine a rotation of the lowest eigenfunctions (without the constant one)."""
        last = len(rotation_target_source) + 1
        moved = self._source[:, 1:last] @ rotation_target_source.T
        return self._zoomout.refine(*mutual_nearest_rows(self._target[:, 1:last], moved))

    def from_functional_map(self, c_source_target: FloatArray) -> FunctionalMap:
        """Refine a functional map, the constant function first."""
        size = len(c_source_target)
        moved = self._source[:, :size] @ c_source_target
        return self._zoomout.refine(*mutual_nearest_rows(self._target[:, :size], moved))

    def from_maps(self, map_target_source: IntArray, map_source_target: IntArray) -> FunctionalMap:
        """Refine maps of the dense samples in both directions, -1 where unknown."""
        return self._zoomout.refine(map_target_source, map_source_target)


def descriptors(target: SpectralShape, source: SpectralShape) -> tuple[FloatArray, FloatArray] | None:
    """Return the curvatures of all working vertices, each of mean 0 and variance 1; None without normals."""
    if not (np.isfinite(target.curvature).all() and np.isfinite(source.curvature).all()):
        return None
    return _standardised(target), _standardised(source)


def dense_point_maps(
    target: SpectralShape, source: SpectralShape, c_source_target: FloatArray, *, with_curvature: bool = True
) -> tuple[IntArray, IntArray]:
    """Return the point maps between all working vertices that belong to a functional map, in both directions.

    Parameters
    ----------
    target, source : SpectralShape
    c_source_target : ndarray, shape (m, m)
        The constant function first.
    with_curvature : bool
        Let curvatures count in the nearest neighbours, as in the refinement.

    Returns
    -------
    map_target_source : ndarray of int, shape (w_source,)
    map_source_target : ndarray of int, shape (w_target,)
    """
    size = len(c_source_target)
    rows_target, rows_source = target.basis[:, :size], source.basis[:, :size] @ c_source_target
    features = descriptors(target, source) if with_curvature else None
    if features is not None:
        weight = CURVATURE_WEIGHT * np.sqrt(size)
        rows_target = np.hstack([rows_target, weight * features[0]])
        rows_source = np.hstack([rows_source, weight * features[1]])
    return mutual_nearest_rows(rows_target, rows_source)


def _standardised(shape: SpectralShape) -> FloatArray:
    centred = shape.curvature - shape.mass @ shape.curvature
    deviation = np.sqrt(shape.mass @ centred**2)
    return centred / np.where(deviation > 0, deviation, 1.0)
