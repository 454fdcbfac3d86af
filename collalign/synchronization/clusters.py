"""Splitting a heterogeneous folder: which shapes belong together, by consistency and energy of their pairs."""

from __future__ import annotations

import numpy as np
import scipy

from collalign.synchronization.frames import transposed
from collalign.synchronization.graph import PairGraph
from data_tools.arrays import FloatArray, IntArray

#: Triangles that close within this squared distance (30 degrees) support their pairs.
CLOSED = 8.0 * np.sin(np.deg2rad(15.0)) ** 2

#: Eigenvalues of the normalised affinity below this are noise.
LEAST_EIGENVALUE = 0.02

#: Closed triangles that are added to every pair's count: no pair of shapes is without any affinity.
PRIOR_CLOSED = 1e-3

#: Affinities that are averaged into what is typical of a shape, and the least of it, relative to the largest.
NUM_TYPICAL, LEAST_TYPICAL = 5, 1e-9

#: Rounds of k-means.
MAX_KMEANS = 100

#: Parts that are looked for, at most.
MAX_PARTS = 12

#: Third shapes looked at per pair, at most.
MAX_TRIANGLES = 64


def pair_affinity(graph: PairGraph) -> FloatArray:
    """Return the closure rate of the triangles over each pair, weighted by energy, shape (N, N).

    A triangle closes when ``R_i_j R_j_k`` is within 30 degrees of ``R_i_k`` for the pairs' best candidates. A pair
    whose lowest energy is above the median is trusted less, by their ratio.
    """
    count, dim = graph.num_shapes, graph.dim
    table = np.zeros((count, count, dim * dim))
    chosen = graph.chosen(graph.best_choice)
    left, right = graph.edges.T
    table[left, right] = chosen.reshape(-1, dim * dim)
    table[right, left] = transposed(chosen).reshape(-1, dim * dim)
    joined = np.zeros((count, count), dtype=bool)
    joined[left, right] = joined[right, left] = graph.weights > 0
    affinity = np.zeros((count, count))
    for (i, j), rotation in zip(graph.edges, chosen, strict=True):
        third = np.flatnonzero(joined[i] & joined[j])
        if len(third) > MAX_TRIANGLES:
            third = third[np.linspace(0, len(third) - 1, MAX_TRIANGLES).astype(np.int64)]
        around = rotation @ table[j, third].reshape(-1, dim, dim)
        apart = ((around.reshape(-1, dim * dim) - table[i, third]) ** 2).sum(axis=1)
        affinity[i, j] = affinity[j, i] = (np.sum(apart <= CLOSED) + PRIOR_CLOSED) / (
            len(third) + 1.0
        )
    if graph.energies is not None:
        lowest = np.where(graph.present, graph.energies, np.inf).min(axis=1)
        least = np.maximum(lowest, np.median(lowest))
        trust = np.divide(np.median(lowest), least, out=np.ones(len(least)), where=least > 0)
        affinity[left, right] *= trust
        affinity[right, left] *= trust
    return affinity


def spectral_clusters(affinity: FloatArray, num_clusters: int | None) -> IntArray:
    """Return the part of each shape, shape (N,), parts numbered by first member.

    Parameters
    ----------
    affinity : ndarray, shape (N, N)
        Symmetric, not negative.
    num_clusters : int or None
        By the largest ratio of successive eigenvalues of ``D^-1/2 A D^-1/2`` where it is None. The affinities are
        first divided by what is typical of their shapes (Zelnik-Manor and Perona 2004): members of small parts
        close few triangles.
    """
    count = len(affinity)
    typical = _typical_affinity(affinity)
    scaled = affinity / np.sqrt(np.outer(typical, typical))
    degree = scaled.sum(axis=1)
    spread = 1.0 / np.sqrt(np.maximum(degree, LEAST_TYPICAL * max(degree.max(initial=0.0), 1e-300)))
    values, vectors = scipy.linalg.eigh(spread[:, None] * scaled * spread)
    values, vectors = np.maximum(values[::-1], LEAST_EIGENVALUE), vectors[:, ::-1]
    if num_clusters is None:
        most = min(MAX_PARTS, count - 1)
        num_clusters = 1 + int(np.argmax(values[:most] / values[1 : most + 1])) if most else 1
    rows = vectors[:, :num_clusters]
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    _, found = scipy.cluster.vq.kmeans2(
        rows, _spread_rows(rows, num_clusters), minit="matrix", iter=MAX_KMEANS
    )
    _, first, inverse = np.unique(found, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return np.asarray(order[inverse.ravel()], dtype=np.int64)


def _typical_affinity(affinity: FloatArray) -> FloatArray:
    """Return the mean of the largest affinities of each shape, shape (N,)."""
    nearest = np.sort(affinity, axis=1)[:, -NUM_TYPICAL:]
    return np.maximum(
        nearest.mean(axis=1), LEAST_TYPICAL * max(float(affinity.max(initial=0.0)), 1e-300)
    )


def _spread_rows(rows: FloatArray, count: int) -> FloatArray:
    """Return rows that point as far apart as possible, greedily: deterministic starts for k-means."""
    chosen = [int(np.argmax(np.abs(rows[:, 0])))]
    while len(chosen) < count:
        chosen.append(int(np.argmin(np.abs(rows @ rows[chosen].T).max(axis=1))))
    return rows[chosen].copy()
