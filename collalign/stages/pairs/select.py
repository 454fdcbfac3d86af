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
from numpy.typing import ArrayLike, NDArray

from collalign.stages.pairs.graph import (
    all_pairs,
    identity_hashes,
    near_partners,
    normalised,
    pair_hashes,
    random_partners,
    without_bridges,
)
from data_tools.arrays import FloatArray, IntArray, as_floats, as_indices
from data_tools.checks import check_choice
from data_tools.errors import OptionsError

__all__ = ["adaptive_pairs", "all_pairs", "extend_pairs", "select_pairs"]

#: Strategies of :func:`select_pairs`; ``"adaptive"`` starts as ``"sparse"`` does, see :func:`adaptive_pairs`.
STRATEGIES = ("all", "sparse", "adaptive")
#: Mean number of pairs that contain a shape, in sparse selections.
DEFAULT_DEGREE = 12
#: Shapes below this confidence get further pairs; lower than what is called doubtful in the end, because few pairs
#: say less than they will.
UNCERTAIN = 0.9
#: Pairs per uncertain shape that one round of :func:`adaptive_pairs` adds.
DEFAULT_ADDED = 6


def select_pairs(
    num_shapes: int,
    *,
    strategy: str = "all",
    descriptors: ArrayLike | None = None,
    degree: int = DEFAULT_DEGREE,
    identities: Sequence[str] | None = None,
    seed: int = 0,
) -> IntArray:
    """Choose the pairs to match.

    Parameters
    ----------
    num_shapes : int
    strategy : {"all", "sparse", "adaptive"}
        All N(N-1)/2 pairs, or a sparse selection of about N * degree / 2.
    descriptors : array_like, shape (N, m), optional
        See :func:`collalign.stages.pairs.descriptor.shape_descriptor`. Without them all sparse partners are random.
    degree : int
        Wanted mean number of pairs per shape, half of them nearest neighbours; at least 4.
    identities : sequence of str, optional
        Name or content hash of each shape, so that the random partners do not depend on the order of the shapes or
        on how many there are; the indices by default.
    seed : int

    Returns
    -------
    ndarray of int, shape (E, 2)
        Rows i < j, sorted. The graph is connected, and with three shapes or more no single pair holds it together
        (no bridges): a wrong pair can always be noticed.

    Raises
    ------
    OptionsError
        If an option is impossible.
    InputError
        If the descriptors do not fit.
    """
    check_choice("strategy", strategy, STRATEGIES)
    if num_shapes < 0 or degree < 4:
        raise OptionsError(f"expected num_shapes >= 0 and degree >= 4, got {num_shapes}, {degree}")
    if strategy == "all" or num_shapes <= degree + 1:
        return all_pairs(num_shapes)
    ids = identity_hashes(num_shapes, identities, seed)
    everyone = np.arange(num_shapes)
    if descriptors is None:
        return without_bridges(num_shapes, random_partners(ids, everyone, everyone, degree // 2), None)
    points = _checked(descriptors, num_shapes)
    near = near_partners(points, everyone, everyone, _num_near(degree))
    random = random_partners(ids, everyone, everyone, (degree + 1) // 4)
    return without_bridges(num_shapes, np.concatenate([near, random]), points)


def adaptive_pairs(
    num_shapes: int,
    edges: ArrayLike,
    confidence: ArrayLike,
    *,
    descriptors: ArrayLike | None = None,
    parts: Iterable[Sequence[int] | IntArray] = (),
    threshold: float = UNCERTAIN,
    added: int = DEFAULT_ADDED,
    max_pairs: int | None = None,
    identities: Sequence[str] | None = None,
    seed: int = 0,
) -> IntArray:
    """Choose further pairs where a synchronization was uncertain.

    Parameters
    ----------
    num_shapes : int
    edges : array_like of int, shape (E, 2)
        The pairs that exist already.
    confidence : array_like, shape (N,)
        Of each shape's pose, in [0, 1]; NaN counts as no confidence.
    descriptors : array_like, shape (N, m), optional
        Half of the added partners are the nearest shapes in them that are not paired yet.
    parts : sequence of index sequences
        Parts of the collection without a common frame; shapes outside the largest one count as uncertain.
    threshold : float
        Shapes below this confidence get new partners, the least confident first.
    added : int
        Partners per uncertain shape: confident shapes, as long as there are any.
    max_pairs : int, optional
        At most so many pairs in all.
    identities, seed
        As for :func:`select_pairs`.

    Returns
    -------
    ndarray of int, shape (E', 2)
        New pairs only, rows i < j, sorted; empty where nothing is uncertain or no pair is left.

    Raises
    ------
    InputError
        If the arrays do not fit.
    """
    existing = normalised(as_indices(edges, "edges", upper=num_shapes, shape=(None, 2)))
    sure = np.asarray(confidence, dtype=np.float64).reshape(-1)
    if len(sure) != num_shapes:
        raise OptionsError(f"confidence: expected {num_shapes} values, got {len(sure)}")
    sure = np.where(np.isnan(sure), 0.0, sure)
    sure[_outside_largest(num_shapes, parts)] = 0.0
    uncertain = np.flatnonzero(sure < threshold)
    uncertain = uncertain[np.argsort(sure[uncertain], kind="stable")]
    ids = identity_hashes(num_shapes, identities, seed)
    points = None if descriptors is None else _checked(descriptors, num_shapes)
    partners_of: list[set[int]] = [set() for _ in range(num_shapes)]
    for i, j in existing.tolist():
        partners_of[i].add(j)
        partners_of[j].add(i)
    chosen: list[tuple[int, int]] = []
    for shape in uncertain:
        for i, j in _new_partners(int(shape), sure, threshold, partners_of, points, ids, added):
            if max_pairs is not None and len(chosen) >= max_pairs:
                break
            partners_of[i].add(j)
            partners_of[j].add(i)
            chosen.append((i, j))
    return normalised(np.array(chosen, dtype=np.int64).reshape(-1, 2))


def extend_pairs(
    num_old: int,
    num_new: int,
    *,
    strategy: str = "sparse",
    descriptors: ArrayLike | None = None,
    degree: int = DEFAULT_DEGREE,
    identities: Sequence[str] | None = None,
    seed: int = 0,
) -> IntArray:
    """Choose the pairs that join new shapes to a collection that stays as it is.

    Parameters
    ----------
    num_old, num_new : int
        The new shapes have the indices num_old, ..., num_old + num_new - 1.
    strategy : {"all", "sparse", "adaptive"}
        All pairs that contain a new shape, or ``degree`` partners for each.
    descriptors : array_like, shape (num_old + num_new, m), optional
    degree : int
        Partners of each new shape, all of them old as far as there are enough: half of them the nearest.
    identities, seed
        As for :func:`select_pairs`.

    Returns
    -------
    ndarray of int, shape (E, 2)
        Rows i < j, sorted; every pair contains a new shape, and every new shape is paired with old ones.

    Raises
    ------
    OptionsError
        If there is no old shape, or an option is impossible.
    """
    if strategy not in STRATEGIES or num_old < 1 or num_new < 0 or degree < 2:
        raise OptionsError(
            f"expected a strategy of {STRATEGIES}, num_old >= 1, num_new >= 0, degree >= 2, "
            f"got {strategy!r}, {num_old}, {num_new}, {degree}"
        )
    total = num_old + num_new
    everything = all_pairs(total)
    if strategy == "all" or total <= degree + 1:
        return everything[everything[:, 1] >= num_old]
    ids = identity_hashes(total, identities, seed)
    old, new = np.arange(num_old), np.arange(num_old, total)
    parts = [np.empty((0, 2), dtype=np.int64)]
    num_random = degree
    if descriptors is not None:
        parts.append(near_partners(_checked(descriptors, total), new, old, degree // 2))
        num_random = degree - degree // 2
    parts.append(random_partners(ids, new, old, num_random))
    return normalised(np.concatenate(parts))


def _num_near(degree: int) -> int:
    """Neighbours that each shape names; about a third of them name it back, so pairs are fewer than names."""
    return max(2, degree // 3)


def _checked(descriptors: ArrayLike, num_shapes: int) -> FloatArray:
    return as_floats(descriptors, "descriptors", shape=(num_shapes, None))


def _outside_largest(num_shapes: int, parts: Iterable[Sequence[int] | IntArray]) -> IntArray:
    arrays = [np.asarray(part, dtype=np.int64) for part in parts]
    if len(arrays) < 2:
        return np.empty(0, dtype=np.int64)
    return np.setdiff1d(np.arange(num_shapes), max(arrays, key=len))


def _new_partners(
    shape: int,
    sure: FloatArray,
    threshold: float,
    partners_of: Sequence[Iterable[int]],
    points: FloatArray | None,
    ids: NDArray[np.uint64],
    added: int,
) -> list[tuple[int, int]]:
    """Return new pairs of one uncertain shape: confident partners first, half of them near, half random."""
    is_free = np.ones(len(sure), dtype=np.bool_)
    is_free[[shape, *partners_of[shape]]] = False
    free = np.flatnonzero(is_free)
    is_enough = np.count_nonzero(sure[free] >= threshold) >= 2 * added
    free = free[sure[free] >= threshold] if is_enough else free
    doubt = sure[free] < threshold
    random = free[np.lexsort((pair_hashes(ids[shape], ids[free]), doubt))]
    if points is None:
        partners = random[:added]
    else:
        distances = ((points[free] - points[shape]) ** 2).sum(axis=1)
        near = free[np.lexsort((distances, doubt))][: added // 2]
        partners = np.concatenate([near, random[~np.isin(random, near)][: added - len(near)]])
    return [(min(shape, int(j)), max(shape, int(j))) for j in partners]
