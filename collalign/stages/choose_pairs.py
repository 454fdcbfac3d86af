"""Chooses the pairs: all, or a sparse connected graph that grows in rounds where synchronization is uncertain.

A sparse selection joins every shape to a few of its nearest neighbours in a cheap descriptor (pairs that are easy to
match) and to a few at random (so that a class of similar shapes is not an island, and errors do not add up along
chains). The random partners are chosen by rendezvous hashing (Thaler and Ravishankar 1998) instead of drawing a
random regular graph: shape i takes the shapes j of least hash(i, j). Every shape still has about the same degree, and
when a collection grows all new pairs contain a new shape, so that only those are computed.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import networkx as nx
import numpy as np
import scipy
from numpy.typing import NDArray

from collalign.options import MAX_ROUNDS, AlignOptions, AlignSession
from collalign.products.pair import FormerPairs, Pair
from collalign.products.shapes import Constraints, Excluded, Shapes
from collalign.products.trust import UNCERTAIN
from collalign.stages.match_pairs import match_pairs
from collalign.stages.own_knowledge import with_own
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples

_LEVELS = (np.arange(16) + 0.5) / 16
_INVARIANT_LEVELS = np.array([0.1, 0.3, 0.5, 0.7, 0.9])


def shape_descriptor(samples: Samples) -> FloatArray:
    """Describe a shape, so that similar shapes have similar descriptors (Euclidean distance).

    Quantiles of the samples' distances from the centroid, quantiles of the distances between samples (the D2 shape
    distribution of Osada et al. 2002), extents along the principal axes, and quantiles of the samples' invariants,
    all relative to the size of the shape.

    Parameters
    ----------
    samples : Samples
        Shapes are comparable if they were sampled with the same options.

    Returns
    -------
    ndarray, shape (35 + 5 m,)
        m is the number of invariants. It depends on this shape alone, so adding shapes changes no descriptor.
    """
    size = float(np.linalg.norm(samples.positions)) or 1.0
    points = samples.positions * (len(samples.positions) ** 0.5 / size)
    radii = np.quantile(np.linalg.norm(points, axis=1), _LEVELS)
    distances = (
        np.quantile(scipy.spatial.distance.pdist(points), _LEVELS)
        if len(points) > 1
        else np.zeros(len(_LEVELS))
    )
    extents = np.linalg.svd(points, compute_uv=False) / len(points) ** 0.5
    parts = [radii / 4.0, distances / 4.0, np.pad(extents, (0, 3 - len(extents)))]
    if samples.invariants.shape[1]:
        scaled = samples.invariants * (len(points) ** 0.5 / size)
        parts.append(
            np.quantile(scaled, _INVARIANT_LEVELS, axis=0).ravel() / scaled.shape[1] ** 0.5
        )
    return np.concatenate(parts)


def describe_shapes(shapes: Shapes) -> FloatArray:
    """Return a descriptor of each shape, shape (N, m): similar shapes have similar ones, mirror images the same."""
    return np.stack([shape_descriptor(item) for item in shapes.samples])


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
        See :func:`collalign.stages.choose_pairs.identity_hashes`.
    descriptors : ndarray, shape (N, m), or None
        See :func:`collalign.stages.choose_pairs.shape_descriptor`. Without them all sparse partners are random.

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


def all_pairs(num_shapes: int) -> IntArray:
    """Return all pairs i < j, sorted, shape (N(N-1)/2, 2)."""
    return np.stack(np.triu_indices(num_shapes, 1), axis=1).astype(np.int64).reshape(-1, 2)


def normalised(edges: IntArray) -> IntArray:
    """Return the pairs (E, 2) as rows i < j, sorted, each once and none with itself."""
    rows = np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1)
    return np.unique(rows, axis=0).reshape(-1, 2)


def identity_hashes(identities: Iterable[str], seed: int) -> NDArray[np.uint64]:
    """Return a 64-bit hash of each shape's identity and the seed, shape (N,).

    By content hashes, random partners depend neither on the order of the shapes nor on how many there are. Shapes of
    the same identity are told apart by their order.
    """
    names = list(identities)
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name] += 1
        names[i] = f"{seed} {seen[name]} {name}"
    digests = b"".join(
        hashlib.blake2b(name.encode("utf-8", "surrogateescape"), digest_size=8).digest()
        for name in names
    )
    return np.frombuffer(digests, dtype="<u8").astype(np.uint64)


#: SplitMix64 (Steele, Lea, Flood 2014): its increment, and shift and factor of each round of its finaliser.
_INCREMENT = np.uint64(0x9E3779B97F4A7C15)
_ROUNDS = ((30, np.uint64(0xBF58476D1CE4E5B9)), (27, np.uint64(0x94D049BB133111EB)))
_LAST_SHIFT = np.uint64(31)


def pair_hashes(one: np.uint64, others: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the hashes by which random partners of one shape are chosen: the finaliser of SplitMix64."""
    with np.errstate(over="ignore"):
        x = others + one * _INCREMENT
        for shift, factor in _ROUNDS:
            x = (x ^ (x >> np.uint64(shift))) * factor
        return x ^ (x >> _LAST_SHIFT)


def random_partners(
    ids: NDArray[np.uint64], shapes: IntArray, partners: IntArray, num: int
) -> IntArray:
    """Return, for each shape, pairs with the ``num`` partners of least hash, shape (len(shapes) * num, 2)."""
    pairs = []
    for shape in shapes:
        others = partners[partners != shape]
        order = _least(pair_hashes(ids[shape], ids[others]), num)
        pairs.append(np.stack([np.full(len(order), shape), others[order]], axis=1))
    return np.concatenate(pairs) if pairs else np.empty((0, 2), dtype=np.int64)


def _least(values: NDArray[Any], num: int) -> IntArray:
    """Return the positions of the ``num`` least values, the least first."""
    if num < len(values):
        candidates = np.flatnonzero(values <= np.partition(values, num)[num])
    else:
        candidates = np.arange(len(values))
    return candidates[np.argsort(values[candidates], kind="stable")[:num]]


def near_partners(points: FloatArray, shapes: IntArray, partners: IntArray, num: int) -> IntArray:
    """Return pairs (e, 2) of each of some shapes (n,) with the ``num`` partners of nearest descriptors, (N, m)."""
    num = min(num + 1, len(partners))  # one more, since a shape may find itself
    if not len(shapes) or not num:
        return np.empty((0, 2), dtype=np.int64)
    _, found = scipy.spatial.KDTree(points[partners]).query(points[shapes], k=num)
    found = partners[np.asarray(found).reshape(len(shapes), num)]
    rows = [
        found_of[found_of != shape][: max(num - 1, 1)]
        for shape, found_of in zip(shapes, found, strict=True)
    ]
    return np.concatenate(
        [
            np.stack([np.full(len(row), shape), row], axis=1)
            for shape, row in zip(shapes, rows, strict=True)
        ]
    )


def without_bridges(num_shapes: int, edges: IntArray, points: FloatArray | None) -> IntArray:
    """Add the fewest pairs that make the graph connected and free of bridges (networkx, Eswaran and Tarjan 1976)."""
    graph = nx.Graph()
    graph.add_nodes_from(range(num_shapes))
    rows = normalised(edges)
    graph.add_edges_from(rows.tolist())
    components = [sorted(part) for part in nx.connected_components(graph)]
    joins = [_closest(points, components[0], part) for part in components[1:]]
    graph.add_edges_from(joins)
    joins += [(int(i), int(j)) for i, j in nx.k_edge_augmentation(graph, k=2)]
    return normalised(np.concatenate([rows, np.array(joins, dtype=np.int64).reshape(-1, 2)]))


def _closest(points: FloatArray | None, part: list[int], other: list[int]) -> tuple[int, int]:
    if points is None:
        return part[0], other[0]
    distances, found = scipy.spatial.KDTree(points[part]).query(points[other])
    best = int(np.argmin(distances))
    return part[int(found[best])], other[best]


#: Collections up to this size match all their pairs with ``pairs="auto"``.
MAX_ALL_PAIRS = 40


def choose_pairs(
    session: AlignSession,
    shapes: Shapes,
    descriptors: FloatArray,
    constraints: Constraints,
    former: FormerPairs | None = None,
) -> IntArray:
    """Return the pairs that ``options.pairs`` asks for, target and source of each, shape (E, 2).

    Parameters
    ----------
    session : Session
    shapes : Shapes
    descriptors : ndarray, shape (N, m)
    constraints : Constraints
        Pairs with proposed poses are matched, those of no weight are not.
    former : FormerPairs, optional
        What an earlier run matched: only pairs with a new shape come on top.
    """
    strategy = _strategy(len(shapes.names), session.options)
    hashes = identity_hashes(shapes.keys, session.options.seed)
    if former is None or not former.num_shapes:
        edges = select_pairs(strategy, hashes, descriptors)
    else:
        edges = _merged(
            former.edges, extend_pairs(former.num_shapes, strategy, hashes, descriptors)
        )
    return _merged(edges, np.array([*constraints.candidates], dtype=np.int64).reshape(-1, 2))


def match_chosen(
    session: AlignSession, shapes: Shapes, edges: IntArray, constraints: Constraints
) -> tuple[list[Pair], list[Excluded]]:
    """Match pairs (E, 2) as :func:`match_pairs` does, with what the caller knows of them."""
    counts = [constraints.weights.get((i, j), 1.0) > 0 for i, j in edges.tolist()]
    pairs, failed = match_pairs(session, shapes, edges[counts])
    return with_own(session, shapes, pairs, constraints), failed


def grow_pairs(
    session: AlignSession,
    shapes: Shapes,
    descriptors: FloatArray,
    edges: IntArray,
    pairs: list[Pair],
    failed: list[Excluded],
    constraints: Constraints,
) -> tuple[list[Pair], list[Excluded], SynchronizationResult | None]:
    """Match further pairs, in rounds, where the synchronization of those before is uncertain.

    Parameters
    ----------
    session : Session
        With ``options.pairs`` other than "adaptive" (or "auto" of many shapes) nothing is added.
    shapes, descriptors, edges
        The shapes, and the pairs that were to be matched so far.
    pairs, failed
        What became of them.
    constraints : Constraints

    Returns
    -------
    pairs, failed
        What became of all pairs.
    solution : SynchronizationResult or None
        Of exactly these pairs, without fixed shapes; None where the last round was not synchronized any more.
    """
    num = len(shapes.names)
    hashes = identity_hashes(shapes.keys, session.options.seed)
    for _ in range(MAX_ROUNDS if _strategy(num, session.options) == "adaptive" else 0):
        solution = synchronize_pairs(session.options, num, pairs)
        added = adaptive_pairs(edges, solution.confidence, solution.parts, hashes, descriptors)
        if not len(added):
            return pairs, failed, solution
        edges = _merged(edges, added)
        pairs, failed = match_chosen(session, shapes, edges, constraints)
    return pairs, failed, None


def planned_edges(num_shapes: int, options: AlignOptions) -> IntArray:
    """Return about the pairs that a run would match first, before any shape has been read."""
    hashes = identity_hashes(map(str, range(num_shapes)), options.seed)
    return select_pairs(_strategy(num_shapes, options), hashes, None)


def _strategy(num_shapes: int, options: AlignOptions) -> str:
    if options.pairs == "auto":
        return "all" if num_shapes <= MAX_ALL_PAIRS else "adaptive"
    return options.pairs


def _merged(edges: IntArray, added: IntArray) -> IntArray:
    return np.unique(np.concatenate([edges, added]), axis=0)
