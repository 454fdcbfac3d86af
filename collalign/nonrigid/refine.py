"""Refining maps of samples to maps of dense samples, and those to maps of all vertices.

**Torn maps.**
No smooth map exchanges the ends of two legs that stand side by side: neighbours go far apart on the way, and what
lies beyond is wrong far more often than the rest (4 % of the points of nine maps between cats and dogs, all wrong).
"""

from __future__ import annotations

import numpy as np
import scipy

from collalign.confidence.map_model import NEAR
from collalign.nonrigid.functional_map import (
    FunctionalMap,
    ZoomOut,
    mutual_nearest_rows,
    zoomout_sizes,
)
from collalign.nonrigid.map_evidence import paired_forms
from collalign.nonrigid.map_options import TUNED
from collalign.nonrigid.spectral_shape import SpectralShape
from collalign.nonrigid.tips import edge_net
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.surface.topology import mesh_edges, vertex_components


class Refiner:
    """ZoomOut between the dense samples of two shapes, prepared once for all candidates of the pair.

    Parameters
    ----------
    target, source : SpectralShape
    first : int
        Number of functions, the constant one included, at the start.
    factor : float
        Growth of the number of functions from step to step.
    last, num_dense : int, optional
        Number of functions at the end, and how many of the dense samples are used; all by default.
    curvature_weight : float
        Root mean square weight of a curvature relative to one function.
    """

    def __init__(
        self,
        target: SpectralShape,
        source: SpectralShape,
        *,
        first: int,
        factor: float,
        last: int | None = None,
        num_dense: int | None = None,
        curvature_weight: float = TUNED.curvature_weight,
    ) -> None:
        on_target, on_source = target.dense[:num_dense], source.dense[:num_dense]
        most = min(len(target.eigenvalues), len(source.eigenvalues)) + 1
        last = min(last or most, most)
        self._form_target = target.orientation[:num_dense]
        self._form_source = source.orientation[:num_dense]
        self._target, self._source = target.basis[on_target], source.basis[on_source]
        has_normals = np.isfinite(target.curvature).all() and np.isfinite(source.curvature).all()
        features = None
        if has_normals:
            features = _standardised(target)[on_target], _standardised(source)[on_source]
        self.zoomout = ZoomOut(
            self._target,
            self._source,
            zoomout_sizes(min(first, last), last, factor=factor),
            descriptors=features,
            descriptor_weight=curvature_weight,
        )

    def from_rotation(self, rotation_target_source: FloatArray) -> FunctionalMap:
        """Refine a rotation (q, q) of the lowest eigenfunctions, without the constant one."""
        size = len(rotation_target_source) + 1
        c_source_target = np.eye(size)
        c_source_target[1:, 1:] = rotation_target_source.T
        return self.from_functional_map(c_source_target)

    def from_functional_map(self, c_source_target: FloatArray) -> FunctionalMap:
        """Refine a functional map (q, q), the constant function first."""
        size = len(c_source_target)
        moved = self._source[:, :size] @ c_source_target
        return self.zoomout.refine(*mutual_nearest_rows(self._target[:, :size], moved))

    def oriented(self, c_source_target: FloatArray, *, preserving: bool) -> FunctionalMap:
        """Refine the lowest functions of a functional map (m, m) towards keeping, or reversing, the orientation.

        Few functions do not tell the two sides of a limb or a trunk apart, but the orientation form does: it changes
        its sign from one side to the other. So the first nearest neighbours compare both, and each coarse map leads
        to a map that keeps left and right and to one that swaps them.
        """
        size = min(len(c_source_target), TUNED.num_oriented)
        weight = np.sqrt(size)
        on_target, on_source = paired_forms(
            self._form_target, self._form_source, c_source_target, sign=1.0 if preserving else -1.0
        )
        moved = self._source[:, :size] @ c_source_target[:size, :size]
        rows_target = np.hstack([self._target[:, :size], weight * unit_rows(on_target)])
        rows_source = np.hstack([moved, weight * unit_rows(on_source)])
        return self.zoomout.refine(*mutual_nearest_rows(rows_target, rows_source))


def unit_rows(values: FloatArray) -> FloatArray:
    """Return rows (n, q) scaled together such that their root mean square length is one."""
    size = float(np.sqrt((values**2).sum(axis=1).mean()))
    return values / size if size > 0 else values


def _standardised(shape: SpectralShape) -> FloatArray:
    """Return the curvatures of all working vertices, each of mean 0 and variance 1."""
    centred = shape.curvature - shape.mass @ shape.curvature
    deviation = np.sqrt(shape.mass @ centred**2)
    return centred / np.where(deviation > 0, deviation, 1.0)


def without_torn_ends(
    target: SpectralShape, source: SpectralShape, torn: FunctionalMap
) -> tuple[IntArray, IntArray]:
    """Return the maps of the samples of two meshes, (k,) and (n,), with -1 beyond where they are torn."""
    of_target, of_source = _Net(target), _Net(source)
    there, back = torn.map_target_source, torn.map_source_target
    return (
        np.where(of_source.largest_piece(there, of_target), there, -1),
        np.where(of_target.largest_piece(back, of_source), back, -1),
    )


class _Net:
    """Which dense samples of a mesh are neighbours across the surface, and which are near."""

    def __init__(self, spectral: SpectralShape) -> None:
        edges, places = mesh_edges(spectral.faces), spectral.vertices / spectral.area**0.5
        _, _, nearest = scipy.sparse.csgraph.dijkstra(
            edge_net(places, spectral.faces),
            directed=False,
            indices=spectral.dense,
            min_only=True,
            return_predecessors=True,
        )
        sample = np.zeros(len(places), dtype=np.int64)
        sample[spectral.dense] = np.arange(len(spectral.dense))
        pairs = np.unique(np.sort(sample[nearest[edges]], axis=1), axis=0)
        self._pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        lengths, num = _lengths(places[spectral.dense], self._pairs), len(spectral.dense)
        net = scipy.sparse.csr_array((lengths, self._pairs.T), shape=(num, num))
        self._is_near = np.isfinite(
            scipy.sparse.csgraph.dijkstra(net, directed=False, limit=2.0 * NEAR)
        )

    def largest_piece(self, images: IntArray, other: _Net) -> BoolArray:
        """Return which samples hang together with most others in a map of them to another surface's samples."""
        pairs = self._pairs[other._is_near[tuple(images[self._pairs].T)]]
        piece = vertex_components(len(images), [pairs])[1]
        return np.asarray(piece == np.bincount(piece).argmax())


def _lengths(places: FloatArray, edges: IntArray) -> FloatArray:
    return np.asarray(np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1))
