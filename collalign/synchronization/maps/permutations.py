"""Consistent labels of the samples over a collection: permutation synchronization, full or partial.

Every sample gets a label of a common universe, no two samples of one shape the same one. Two samples correspond if
they share a label, so that ``map_a_b[map_b_c] == map_a_c`` wherever both sides are matched, exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import breadth_first_order

from data_tools.arrays import BoolArray, FloatArray, IntArray, as_indices, as_points, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Most that the distance to a label counts, relative to the strongest support by maps.
NEARNESS_SHARE = 0.5

#: A sample's label counts this much more than others of equal support, relative to the strongest.
TIE_SHARE = 1e-6

#: Samples times labels whose support is held at once: of ten thousand shapes all of it would take a gibibyte.
MOST_HELD = 2**22

#: Rounds of projected power iteration, at most.
MAX_ROUNDS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class UniverseLabels:
    """Labels of the samples of every shape.

    Attributes
    ----------
    labels : tuple of ndarray of int
        Per shape, the label of each sample in ``[0, universe)``, -1 where it has none.
    universe : int
        Number of labels.
    agreement : float
        Share of the given matches that the labels keep.
    rounds : int
    """

    labels: tuple[IntArray, ...]
    universe: int
    agreement: float
    rounds: int


@one_blas_thread()
def synchronize_maps(
    maps: Mapping[tuple[int, int], ArrayLike],
    num_samples: Sequence[int],
    *,
    weights: Mapping[tuple[int, int], float] | None = None,
    positions: Sequence[ArrayLike] | None = None,
    universe: int | None = None,
    min_support: float = 0.0,
) -> UniverseLabels:
    """Find consistent labels by projected power iteration (Chen and Candes 2018; Pachauri et al. 2013).

    Each round every shape votes: the label of a sample is supported by the labels of the samples matched to it, and
    the labels of one shape are the linear assignment of most support. Sparse in the pairs: time and memory grow with
    their number times the samples.

    Parameters
    ----------
    maps : mapping of (i, j) to array_like of int, shape (k_j,)
        ``map_i_j``: the sample on i of each sample of j, -1 where unmatched.
    num_samples : sequence of int
        k_i of each shape.
    weights : mapping of (i, j) to float, optional
        Trust in each map, one by default.
    positions : sequence of array_like, shape (k_i, d), optional
        Samples in the common frame: they add support to labels whose members are near, and start the iteration.
    universe : int, optional
        Number of labels, the largest number of samples by default.
    min_support : float
        A label is given only if at least this share of the shape's maps (by weight) supports it; 0 labels all.

    Raises
    ------
    InputError
        If a map names shapes or samples that do not exist, or is not one-to-one.
    """
    sizes = np.array([int(k) for k in num_samples], dtype=np.int64)
    total = int(universe) if universe is not None else int(sizes.max(initial=0))
    if len(sizes) == 0 or sizes.min() < 1 or total < sizes.max():
        raise InputError(f"num_samples: expected 1 to {total} samples per shape, got {sizes.tolist()}")
    starts = np.concatenate([[0], np.cumsum(sizes)])
    matches = _match_matrix(maps, weights or {}, sizes, starts)
    clouds = _checked_positions(positions, sizes)
    labels = _first_labels(matches, starts, total, clouds)
    previous, rounds = None, 0
    while rounds < MAX_ROUNDS:
        rounds += 1
        fresh = _elected(matches, labels, starts, total, clouds)
        if np.array_equal(fresh, labels) or (previous is not None and np.array_equal(fresh, previous)):
            break
        previous, labels = labels, fresh
    labels = _without_weak(matches, labels, min_support)
    parts = tuple(read_only(labels[starts[i] : starts[i + 1]].copy()) for i in range(len(sizes)))
    return UniverseLabels(labels=parts, universe=total, agreement=_kept_share(matches, labels), rounds=rounds)


def _match_matrix(
    maps: Mapping[tuple[int, int], ArrayLike],
    weights: Mapping[tuple[int, int], float],
    sizes: IntArray,
    starts: IntArray,
) -> csr_matrix:
    """Return the symmetric sparse matrix of weighted matches over all samples of all shapes."""
    rows, cols, values = [], [], []
    for (i, j), found in maps.items():
        if not (0 <= i < len(sizes) and 0 <= j < len(sizes)) or i == j:
            raise InputError(f"maps: the pair ({i}, {j}) of {len(sizes)} shapes")
        index = as_indices(found, f"maps[{i}, {j}]", upper=int(sizes[i]), lower=-1, shape=(int(sizes[j]),))
        matched = np.flatnonzero(index >= 0)
        if len(np.unique(index[matched])) != len(matched):
            raise InputError(f"maps[{i}, {j}]: two samples of {j} go to one of {i}")
        weight = float(weights.get((i, j), 1.0))
        if not (np.isfinite(weight) and weight >= 0.0):
            raise InputError(f"weights[{i}, {j}]: expected a number >= 0, got {weight}")
        rows.append(starts[i] + index[matched])
        cols.append(starts[j] + matched)
        values.append(np.full(len(matched), weight))
    size = int(starts[-1])
    if not rows:
        return csr_matrix((size, size))
    upper = csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(size, size))
    return (upper + upper.T).tocsr()


def _checked_positions(positions: Sequence[ArrayLike] | None, sizes: IntArray) -> FloatArray | None:
    if positions is None:
        return None
    clouds = [as_points(cloud, f"positions[{i}]") for i, cloud in enumerate(positions)]
    if [len(cloud) for cloud in clouds] != sizes.tolist() or len({cloud.shape[1] for cloud in clouds}) != 1:
        raise InputError("positions: expected the samples of every shape, in one dimension")
    return np.concatenate(clouds)


def _first_labels(matches: csr_matrix, starts: IntArray, total: int, clouds: FloatArray | None) -> IntArray:
    """Return labels spread from the best connected of the largest shapes, by assignment to those already labelled."""
    count = len(starts) - 1
    owner = np.repeat(np.arange(count), np.diff(starts))
    labels = np.full(starts[-1], -1, dtype=np.int64)
    coarse = csr_matrix((np.ones(len(owner)), (owner, np.arange(len(owner)))), shape=(count, len(owner)))
    between = (coarse @ matches @ coarse.T).tocsr()
    strength = np.asarray(between.sum(axis=1)).ravel()
    root = int(np.lexsort((strength, np.diff(starts)))[-1])
    labels[starts[root] : starts[root + 1]] = np.arange(starts[root + 1] - starts[root])
    reached = breadth_first_order(between, root, directed=False, return_predecessors=False)
    for shape in (*reached[1:], *np.setdiff1d(np.arange(count), reached)):
        part = slice(starts[shape], starts[shape + 1])
        support = np.asarray(_support(matches[part], labels, total).todense())
        if clouds is not None:
            seen = labels >= 0
            centres = _label_means(clouds[seen], labels[seen], total)
            far = ((clouds[part][:, None] - centres) ** 2).sum(axis=2)
            support = support - np.where(np.isnan(far), np.nanmax(far), far) / max(float(np.nanmax(far)), 1e-300)
        labels[part] = linear_sum_assignment(-support)[1]
    return labels


def _elected(
    matches: csr_matrix, labels: IntArray, starts: IntArray, total: int, clouds: FloatArray | None
) -> IntArray:
    """Return the labels that the samples' matches, and their places, elect: one round, some shapes at a time."""
    support = _support(matches, labels, total)
    near = None if clouds is None else _Nearness(clouds, labels, total, scale=float(support.max()))
    fresh = labels.copy()
    for a, b in _slabs(starts, total):
        rows = slice(starts[a], starts[b])
        held = np.asarray(support[rows].todense())
        if near is not None:
            held += near.of(rows)
        fresh[rows] = _assigned(held, starts[a : b + 1] - starts[a], labels[rows])
    return fresh


def _slabs(starts: IntArray, total: int) -> list[tuple[int, int]]:
    """Return ranges of shapes, at least one each, of at most :data:`MOST_HELD` samples times labels."""
    rows, slabs, first = max(1, MOST_HELD // total), [], 0
    while first < len(starts) - 1:
        last = max(first + 1, int(np.searchsorted(starts, starts[first] + rows, side="right")) - 1)
        slabs.append((first, last))
        first = last
    return slabs


def _support(matches: csr_matrix, labels: IntArray, total: int) -> csr_matrix:
    """Return the weight with which each sample's matches vote for each label, shape (rows, universe)."""
    seen = np.flatnonzero(labels >= 0)
    return matches @ csr_matrix((np.ones(len(seen)), (seen, labels[seen])), shape=(len(labels), total))


class _Nearness:
    """Support up to ``NEARNESS_SHARE`` scale that falls with the distance to the mean of a label's members."""

    def __init__(self, clouds: FloatArray, labels: IntArray, total: int, *, scale: float) -> None:
        self._clouds, self._centres = clouds, _label_means(clouds, labels, total)
        self._most = NEARNESS_SHARE * max(scale, 1.0)
        own = ((clouds - self._centres[labels]) ** 2).sum(axis=1)
        self._typical = max(float(np.nanmedian(own)), 1e-300)

    def of(self, rows: slice) -> FloatArray:
        """Return the support of some samples for all labels, shape (rows, universe)."""
        clouds = self._clouds[rows]
        squared = (clouds**2).sum(axis=1)[:, None] + (self._centres**2).sum(axis=1) - 2.0 * clouds @ self._centres.T
        return np.nan_to_num(self._most * np.exp(-np.maximum(squared, 0.0) / (2.0 * self._typical)))


def _label_means(clouds: FloatArray, labels: IntArray, total: int) -> FloatArray:
    """Return the mean of the samples of each label, shape (universe, d); NaN where there are none."""
    count = np.bincount(labels, minlength=total).astype(np.float64)
    sums = np.stack([np.bincount(labels, weights=column, minlength=total) for column in clouds.T], axis=1)
    return sums / np.where(count > 0, count, np.nan)[:, None]


def _assigned(support: FloatArray, starts: IntArray, labels: IntArray) -> IntArray:
    """Return the linear assignment of most support of every shape; ties keep the label that a sample has."""
    fresh = labels.copy()
    for first, last in pairwise(starts):
        part = support[first:last].copy()
        part[np.arange(last - first), labels[first:last]] += TIE_SHARE * max(float(part.max(initial=0.0)), 1.0)
        fresh[first:last] = linear_sum_assignment(-part)[1]
    return fresh


def _without_weak(matches: csr_matrix, labels: IntArray, min_support: float) -> IntArray:
    """Return the labels with -1 where too small a share of a sample's matches supports them."""
    if min_support <= 0.0:
        return labels
    pairs, same = _kept(matches, labels)
    own = np.bincount(pairs.row[same], weights=pairs.data[same], minlength=len(labels))
    every = np.asarray(matches.sum(axis=1)).ravel()
    return np.where(own >= min_support * np.maximum(every, 1e-300), labels, -1)


def _kept_share(matches: csr_matrix, labels: IntArray) -> float:
    """Return the share, by weight, of the matches whose two samples have one label."""
    pairs, same = _kept(matches, labels)
    return float(pairs.data[same].sum() / max(float(pairs.data.sum()), 1e-300))


def _kept(matches: csr_matrix, labels: IntArray) -> tuple[coo_matrix, BoolArray]:
    """Return all matches, and of which both samples have one label."""
    pairs = matches.tocoo()
    return pairs, (labels[pairs.row] == labels[pairs.col]) & (labels[pairs.row] >= 0)
