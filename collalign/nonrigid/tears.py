"""Maps that are torn: pieces of a surface that went elsewhere than what they hang together with.

No smooth map exchanges the ends of two legs that stand side by side: neighbours go far apart on the way, and what
lies beyond is wrong far more often than the rest (4 % of the points of nine maps between cats and dogs, all wrong).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from collalign.confidence.map_model import NEAR
from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.surface.spectral_shape import SpectralShape
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.surface.topology import mesh_edges


def without_torn_ends(target: SpectralShape, source: SpectralShape, torn: FunctionalMap) -> tuple[IntArray, IntArray]:
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
        surface = csr_array((_lengths(places, edges), edges.T), shape=(len(places),) * 2)
        nearest = dijkstra(surface, directed=False, indices=spectral.dense, min_only=True, return_predecessors=True)[
            2
        ]
        sample = np.zeros(len(places), dtype=np.int64)
        sample[spectral.dense] = np.arange(len(spectral.dense))
        pairs = np.unique(np.sort(sample[nearest[edges]], axis=1), axis=0)
        self._pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        lengths, num = _lengths(places[spectral.dense], self._pairs), len(spectral.dense)
        net = csr_array((lengths, self._pairs.T), shape=(num, num))
        self._is_near = np.isfinite(dijkstra(net, directed=False, limit=2.0 * NEAR))

    def largest_piece(self, images: IntArray, other: _Net) -> BoolArray:
        """Return which samples hang together with most others in a map of them to another surface's samples."""
        pairs = self._pairs[other._is_near[tuple(images[self._pairs].T)]]
        graph = csr_array((np.ones(len(pairs)), pairs.T), shape=(len(images),) * 2)
        piece = connected_components(graph, directed=False)[1]
        return np.asarray(piece == np.bincount(piece).argmax())


def _lengths(places: FloatArray, edges: IntArray) -> FloatArray:
    return np.asarray(np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1))
