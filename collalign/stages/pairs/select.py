"""Which pairs of shapes are matched: all, or a sparse connected graph that may grow where poses are uncertain.

A sparse selection joins every shape to a few of its nearest neighbours in a cheap descriptor (pairs that are easy to
match) and to a few at random (so that a class of similar shapes is not an island, and errors do not add up along
chains). The random partners are chosen by rendezvous hashing (Thaler and Ravishankar 1998) instead of drawing a
random regular graph: shape i takes the shapes j of least hash(i, j). Every shape still has about the same degree, and
when a collection grows all new pairs contain a new shape, so that only those are computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from collalign.products.trust import UNCERTAIN
from collalign.stages.pairs.sparse_pairs import (
    all_pairs,
    near_partners,
    normalised,
    pair_hashes,
    random_partners,
    without_bridges,
)
from data_tools.arrays import FloatArray, IntArray

#: Mean number of pairs that contain a shape, in sparse selections.
DEGREE = 12
#: Neighbours that each shape names; about a third of them name it back, so pairs are fewer than names.
NUM_NEAR = 4
#: Pairs per uncertain shape that one round of :func:`adaptive_pairs` adds.
ADDED = 6


def select_pairs(
    strategy: str, hashes: NDArray[np.uint64], descriptors: FloatArray | None
) -> IntArray:
    """Choose the pairs to match.

    Parameters
    ----------
    strategy : {"all", "sparse", "adaptive"}
        All N(N-1)/2 pairs, or a sparse selection of about N * :data:`DEGREE` / 2; ``"adaptive"`` starts with that.
    hashes : ndarray of uint64, shape (N,)
        See :func:`collalign.stages.pairs.sparse_pairs.identity_hashes`.
    descriptors : ndarray, shape (N, m), or None
        See :func:`collalign.stages.pairs.descriptor.shape_descriptor`. Without them all sparse partners are random.

    Returns
    -------
    ndarray of int, shape (E, 2)
        Rows i < j, sorted. The graph is connected, and with three shapes or more no single pair holds it together
        (no bridges): a wrong pair can always be noticed.
    """
    num_shapes = len(hashes)
    if strategy == "all" or num_shapes <= DEGREE + 1:
        return all_pairs(num_shapes)
    everyone = np.arange(num_shapes)
    if descriptors is None:
        return without_bridges(
            num_shapes, random_partners(hashes, everyone, everyone, DEGREE // 2), None
        )
    near = near_partners(descriptors, everyone, everyone, NUM_NEAR)
    random = random_partners(hashes, everyone, everyone, DEGREE // 4)
    return without_bridges(num_shapes, np.concatenate([near, random]), descriptors)


def adaptive_pairs(
    edges: IntArray,
    confidence: FloatArray,
    parts: Sequence[IntArray],
    hashes: NDArray[np.uint64],
    descriptors: FloatArray,
) -> IntArray:
    """Choose further pairs where a synchronization was uncertain, the least confident shapes first.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
        The pairs that exist already.
    confidence : ndarray, shape (N,)
        Of each shape's pose, in [0, 1]; NaN counts as no confidence.
    parts : sequence of ndarray of int
        Parts of the collection without a common frame; shapes outside the largest one count as uncertain.
    hashes, descriptors
        As for :func:`select_pairs`. Half of the added partners are the nearest shapes that are not paired yet.

    Returns
    -------
    ndarray of int, shape (E', 2)
        New pairs only, rows i < j, sorted; empty where nothing is uncertain or no pair is left.
    """
    sure = np.where(np.isnan(confidence), 0.0, confidence)
    if len(parts) > 1:
        sure[np.setdiff1d(np.arange(len(sure)), max(parts, key=len))] = 0.0
    uncertain = np.flatnonzero(sure < UNCERTAIN)
    partners_of: list[set[int]] = [set() for _ in sure]
    chosen = list[tuple[int, int]]()
    for i, j in edges.tolist():
        partners_of[i].add(j)
        partners_of[j].add(i)
    for shape in uncertain[np.argsort(sure[uncertain], kind="stable")].tolist():
        for partner in _new_partners(shape, sure, partners_of[shape], hashes, descriptors).tolist():
            partners_of[shape].add(partner)
            partners_of[partner].add(shape)
            chosen.append((shape, partner))
    return normalised(np.array(chosen, dtype=np.int64).reshape(-1, 2))


def extend_pairs(
    num_old: int, strategy: str, hashes: NDArray[np.uint64], descriptors: FloatArray
) -> IntArray:
    """Choose the pairs that join new shapes to a collection that stays as it is.

    Parameters
    ----------
    num_old : int
        The first shapes, at least one; all others are new.
    strategy : {"all", "sparse", "adaptive"}
        All pairs that contain a new shape, or :data:`DEGREE` partners for each, all of them old as far as there are
        enough: half of them the nearest.
    hashes, descriptors
        As for :func:`select_pairs`, of all shapes.

    Returns
    -------
    ndarray of int, shape (E, 2)
        Rows i < j, sorted; every pair contains a new shape, and every new shape is paired with old ones.
    """
    total = len(hashes)
    if strategy == "all" or total <= DEGREE + 1:
        everything = all_pairs(total)
        return everything[everything[:, 1] >= num_old]
    old, new = np.arange(num_old), np.arange(num_old, total)
    near = near_partners(descriptors, new, old, DEGREE // 2)
    return normalised(
        np.concatenate([near, random_partners(hashes, new, old, DEGREE - DEGREE // 2)])
    )


def _new_partners(
    shape: int,
    sure: FloatArray,
    known: Iterable[int],
    hashes: NDArray[np.uint64],
    descriptors: FloatArray,
) -> IntArray:
    """Return new partners of one uncertain shape: confident ones first, half of them near, half random."""
    is_free = np.ones(len(sure), dtype=np.bool_)
    is_free[[shape, *known]] = False
    free = np.flatnonzero(is_free)
    is_enough = np.count_nonzero(sure[free] >= UNCERTAIN) >= 2 * ADDED
    free = free[sure[free] >= UNCERTAIN] if is_enough else free
    doubt = sure[free] < UNCERTAIN
    random = free[np.lexsort((pair_hashes(hashes[shape], hashes[free]), doubt))]
    distances = ((descriptors[free] - descriptors[shape]) ** 2).sum(axis=1)
    near = free[np.lexsort((distances, doubt))][: ADDED // 2]
    return np.concatenate([near, random[~np.isin(random, near)][: ADDED - len(near)]])
