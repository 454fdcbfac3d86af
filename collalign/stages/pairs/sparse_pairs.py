"""The parts of a pair selection: nearest neighbours, random partners by hashing, and graph repair."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from data_tools.arrays import FloatArray, IntArray


def all_pairs(num_shapes: int) -> IntArray:
    """Return all pairs i < j, sorted, shape (N(N-1)/2, 2)."""
    return np.stack(np.triu_indices(num_shapes, 1), axis=1).astype(np.int64).reshape(-1, 2)


def normalised(edges: IntArray) -> IntArray:
    """Return the pairs (E, 2) as rows i < j, sorted, each once and none with itself."""
    rows = np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1)
    return np.unique(rows, axis=0).reshape(-1, 2)


def identity_hashes(identities: Iterable[str], seed: int) -> NDArray[np.uint64]:
    """Return a 64-bit hash of each shape's identity and the seed.

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


def pair_hashes(one: np.uint64, others: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a hash of (one, other) for each other: the finaliser of SplitMix64 (Steele, Lea, Flood 2014)."""
    with np.errstate(over="ignore"):
        x = others + one * np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return x ^ (x >> np.uint64(31))


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
    """Return, for each shape, pairs with the ``num`` partners nearest in the descriptors."""
    num = min(num + 1, len(partners))  # one more, since a shape may find itself
    if not len(shapes) or not num:
        return np.empty((0, 2), dtype=np.int64)
    _, found = KDTree(points[partners]).query(points[shapes], k=num)
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
    distances, found = KDTree(points[part]).query(points[other])
    best = int(np.argmin(distances))
    return part[int(found[best])], other[best]
