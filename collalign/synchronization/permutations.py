"""Consistent labels of the samples over a collection: permutation synchronization.

Every sample gets one of as many labels as a shape has samples, no two samples of one shape the same one. Two samples
correspond if they share a label, so that ``map_a_b[map_b_c] == map_a_c`` exactly.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from collalign.synchronization.graph import checked_edges
from data_tools.arrays import (
    FloatArray,
    IntArray,
    as_floats,
    as_indices,
    as_weights,
    read_only,
    sums_by_owner,
)
from data_tools.errors import InputError
from data_tools.surface.topology import vertex_components
from data_tools.threads import one_blas_thread

#: Most that the distance to a label counts, relative to the strongest support by maps.
NEARNESS_SHARE = 0.5

#: A sample's label counts this much more than others of equal support, relative to the strongest.
TIE_SHARE = 1e-6

#: Samples times labels whose support is held at once: of ten thousand shapes all of it would take a gibibyte.
MOST_HELD = 2**22

#: Rounds of projected power iteration, at most.
MAX_POWER_ITERATIONS = 30


@one_blas_thread()
def synchronize_permutations(
    edges: ArrayLike,
    maps: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    positions: ArrayLike | None = None,
    num_shapes: int | None = None,
) -> IntArray:
    """Find consistent labels of points from the pairs' maps, of which many may be wrong.

    This is permutation synchronization by projected power iteration (Chen and Candes 2018; Pachauri et al. 2013).

    Parameters
    ----------
    edges : array_like of int, shape (E, 2)
        Shapes i, j of each pair; each unordered pair at most once.
    maps : array_like of int, shape (E, k)
        ``map_i_j``: the point of i for each of the k points of j, or -1. No point of i is taken twice.
    weights : array_like, shape (E,), optional
        How much each pair counts; all alike by default.
    positions : array_like, shape (N, k, d), optional
        Points of all shapes in a common frame. Nearness then counts as well, at most half as much as the maps.
    num_shapes : int, optional
        N: one more than the largest index in ``edges`` where neither it nor ``positions`` says so.

    Returns
    -------
    ndarray of int, shape (N, k)
        Label of each point. Each row is a permutation of 0, ..., k - 1. The consistent map of two shapes is
        ``np.argsort(labels[i])[labels[j]]``. Read-only.

    Raises
    ------
    InputError
        If an index is out of range, a pair is a loop or repeated, a map takes a point twice, or without positions a
        shape has no maps to the others.
    OptionsError
        If ``num_shapes`` is less than 1.

    Examples
    --------
    >>> shift, wrong = np.array([1, 2, 3, 0]), np.array([0, 1, 3, 2])
    >>> edges = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    >>> maps = [shift, shift[shift], wrong, shift, shift[shift], shift]
    >>> labels = collalign.synchronize_permutations(edges, maps)
    >>> np.argsort(labels[0])[labels[3]]  # shift three times, although the map of this pair is wrong
    array([3, 0, 1, 2])
    """
    points = None if positions is None else as_floats(positions, "positions", shape=(None,) * 3)
    if points is not None and num_shapes not in (None, len(points)):
        raise InputError(f"positions: of {len(points)} shapes, expected num_shapes {num_shapes}")
    pairs = checked_edges(edges, num_shapes if points is None else len(points))
    if not len(pairs):
        raise InputError("edges: there are no pairs, so no maps to make consistent")
    found = np.asarray(maps)
    size = found.shape[1] if found.ndim == 2 else 0
    found = as_indices(found, "maps", upper=size, lower=-1, shape=(len(pairs), None))
    if points is not None and points.shape[1] != size:
        raise InputError(f"positions: {points.shape[1]} points a shape, but maps of {size}")
    used = np.sort(found, axis=1)
    twice = np.argwhere((used[:, 1:] == used[:, :-1]) & (used[:, 1:] >= 0))
    if len(twice):
        row, at = twice[0]
        raise InputError(f"maps: row {row} takes point {used[row, at]} twice")
    trust = as_weights(weights, "weights", num=len(pairs))
    if points is None:
        total = int(pairs.max()) + 1 if num_shapes is None else num_shapes
        _check_connected(pairs[(trust > 0) & (found >= 0).any(axis=1)], total)
        points = np.zeros((total, size, 1))
    return read_only(synchronize_maps(pairs, found, trust, points))


def _check_connected(edges: IntArray, num: int) -> None:
    """Refuse shapes (num) that pairs (E, 2) do not connect: nothing says which of their points correspond."""
    component = vertex_components(num, [edges])[1]
    apart = np.flatnonzero(component != component[0])
    if len(apart):
        raise InputError(
            f"maps: none connects shape {apart[0]} with shape 0, so their labels cannot be compared; "
            "give positions, or leave it out"
        )


@one_blas_thread()
def synchronize_maps(
    edges: IntArray, maps: IntArray, weights: FloatArray, positions: FloatArray
) -> IntArray:
    """Synchronize as :func:`synchronize_permutations` does, from checked arrays.

    Each round every shape votes: the label of a sample is supported by the labels of the samples matched to it, and
    by how near the members of a label are; the labels of one shape are the linear assignment of most support. Sparse
    in the pairs: time and memory grow with their number times the samples.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
        Shapes i, j of each pair.
    maps : ndarray of int, shape (E, k)
        ``map_i_j``: the sample on i of each sample of j, or -1; one-to-one.
    weights : ndarray, shape (E,)
        Trust in each map.
    positions : ndarray, shape (N, k, d)
        Samples in the common frame.

    Returns
    -------
    ndarray of int, shape (N, k)
        Each row a permutation of 0, ..., k - 1.
    """
    num, total = positions.shape[:2]
    matches = _match_matrix(edges, maps, weights, num)
    labels = _first_labels(matches, positions)
    previous = None
    for _ in range(MAX_POWER_ITERATIONS):
        fresh = _elected(matches, labels, positions)
        if np.array_equal(fresh, labels) or (
            previous is not None and np.array_equal(fresh, previous)
        ):
            break
        previous, labels = labels, fresh
    return labels.reshape(num, total)


def _match_matrix(
    edges: IntArray, maps: IntArray, weights: FloatArray, num: int
) -> scipy.sparse.csr_matrix:
    """Return the symmetric sparse matrix of weighted matches over all samples of all shapes."""
    total = maps.shape[1]
    known = maps >= 0
    rows, cols = edges[:, :1] * total + maps, edges[:, 1:] * total + np.arange(total)
    values = np.broadcast_to(weights[:, None], maps.shape)
    upper = scipy.sparse.csr_matrix(
        (values[known], (rows[known], cols[known])), shape=(num * total,) * 2
    )
    return (upper + upper.T).tocsr()


def _first_labels(matches: scipy.sparse.csr_matrix, positions: FloatArray) -> IntArray:
    """Return labels spread from the best connected shape, by assignment to those already labelled."""
    (num, total, _), clouds = positions.shape, positions.reshape(-1, positions.shape[2])
    owner = np.repeat(np.arange(num), total)
    labels = np.full(num * total, -1, dtype=np.int64)
    coarse = scipy.sparse.csr_matrix(
        (np.ones(len(owner)), (owner, np.arange(len(owner)))), shape=(num, len(owner))
    )
    between = (coarse @ matches @ coarse.T).tocsr()
    strength = np.asarray(between.sum(axis=1)).ravel()
    root = int(np.lexsort((strength,))[-1])
    labels[root * total : (root + 1) * total] = np.arange(total)
    reached = scipy.sparse.csgraph.breadth_first_order(
        between, root, directed=False, return_predecessors=False
    )
    for shape in (*reached[1:], *np.setdiff1d(np.arange(num), reached)):
        part = slice(shape * total, (shape + 1) * total)
        support = np.asarray(_support(matches[part], labels, total).todense())
        seen = labels >= 0
        far = ((clouds[part][:, None] - _label_means(clouds[seen], labels[seen], total)) ** 2).sum(
            axis=2
        )
        labels[part] = scipy.optimize.linear_sum_assignment(
            far / max(float(far.max()), 1e-300) - support
        )[1]
    return labels


def _elected(matches: scipy.sparse.csr_matrix, labels: IntArray, positions: FloatArray) -> IntArray:
    """Return the labels that the samples' matches, and their places, elect: one round, some shapes at a time."""
    (num, total, _), clouds = positions.shape, positions.reshape(-1, positions.shape[2])
    support = _support(matches, labels, total)
    centres = _label_means(clouds, labels, total)
    typical = max(float(np.median(((clouds - centres[labels]) ** 2).sum(axis=1))), 1e-300)
    most = NEARNESS_SHARE * max(float(support.max()), 1.0)
    fresh = labels.copy()
    at_once = max(1, MOST_HELD // total**2)
    for first in range(0, num, at_once):
        rows = slice(first * total, min(first + at_once, num) * total)
        held = np.asarray(support[rows].todense())
        squared = (
            (clouds[rows] ** 2).sum(axis=1)[:, None]
            + (centres**2).sum(axis=1)
            - 2.0 * clouds[rows] @ centres.T
        )
        held += most * np.exp(-np.maximum(squared, 0.0) / (2.0 * typical))
        fresh[rows] = _assigned(
            held.reshape(-1, total, total), labels[rows].reshape(-1, total)
        ).ravel()
    return fresh


def _support(
    matches: scipy.sparse.csr_matrix, labels: IntArray, total: int
) -> scipy.sparse.csr_matrix:
    """Return the weight with which each sample's matches vote for each label, shape (rows, k)."""
    seen = np.flatnonzero(labels >= 0)
    return matches @ scipy.sparse.csr_matrix(
        (np.ones(len(seen)), (seen, labels[seen])), shape=(len(labels), total)
    )


def _label_means(clouds: FloatArray, labels: IntArray, total: int) -> FloatArray:
    """Return the mean of the samples of each label, shape (k, d)."""
    count = np.bincount(labels, minlength=total).astype(np.float64)
    return np.asarray(sums_by_owner(clouds, labels, total) / count[:, None])


def _assigned(support: FloatArray, labels: IntArray) -> IntArray:
    """Return the linear assignment of most support of every shape; ties keep the label that a sample has."""
    fresh = labels.copy()
    for row, part in enumerate(support):
        part[np.arange(len(part)), labels[row]] += TIE_SHARE * max(float(part.max()), 1.0)
        fresh[row] = scipy.optimize.linear_sum_assignment(-part)[1]
    return fresh
