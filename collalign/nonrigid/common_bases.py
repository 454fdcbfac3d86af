"""Maps of a collection: common bases of functions, in which they agree around cycles, and the choice of maps.

Every shape gets a matrix ``Y_i`` that expresses k common functions in its own eigenfunctions, such that a functional
map takes those of its target to those of its source, ``C_source_target Y_target ~ Y_source``. Maps between any two
shapes follow from the bases, and compose around every cycle. This is the synchronization of rotations once more, in k
dimensions instead of three: consistent latent bases (Wang, Huang, Guibas 2013; Huang, Achlioptas, Guibas,
Ovsjanikov 2019), with orthogonal blocks (maps of nearly isometric surfaces are orthogonal; blocks that are free lose
the functions of shapes that fit badly), found by the generalised power method (Boumal 2016), with weights that fall
with the residual as in least absolute deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import networkx as nx
import numpy as np

from collalign.confidence.map_model import FLOOR
from data_tools.arrays import FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal

#: The power iteration ends when no entry changes by more, or after so many steps.
TOLERANCE, MAX_STEPS = 1e-3, 60
#: How often the weights are set by the residuals.
NUM_REWEIGHTED = 3
#: Residuals below this share of their median count as that.
SMALLEST_RESIDUAL = 0.3


def common_bases(
    edges: IntArray, maps: FloatArray, num_shapes: int, weights: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the bases that most maps agree with, and how well each does.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
        Target and source of each map; together they connect all shapes.
    maps : ndarray, shape (E, k, k)
        ``C_source_target``.
    num_shapes : int
    weights : ndarray, shape (E,), optional
        How far each map is trusted at first.

    Returns
    -------
    bases : ndarray, shape (N, k, k)
        Orthogonal: coefficients of the common functions in each shape's own.
    residuals : ndarray, shape (E,)
        Of the maps, see :func:`map_residuals`.

    Raises
    ------
    ValueError
        If the maps do not connect the shapes.
    """
    weights = np.ones(len(edges)) if weights is None else weights
    bases = _along_tree(edges, maps, num_shapes, weights)
    for _ in range(NUM_REWEIGHTED):
        bases = _power_iteration(edges, maps, bases, weights)
        residuals = map_residuals(edges, maps, bases)
        weights = residual_weights(residuals)
    return bases, residuals


def map_residuals(edges: IntArray, maps: FloatArray, bases: FloatArray) -> FloatArray:
    """Return how far maps are from what the bases ask for, shape (E,).

    That is ``|C Y_target - Y_source|_F / sqrt(k)``: 0 if a map agrees, some 1.4 if it has nothing to do with it.
    """
    gaps = maps @ bases[edges[:, 0]] - bases[edges[:, 1]]
    return np.asarray(np.linalg.norm(gaps, axis=(1, 2)) / np.sqrt(bases.shape[-1]))


def residual_weights(residuals: FloatArray) -> FloatArray:
    """Return weights of maps by their residuals, shape (e,) both, 1 at the median one."""
    median = max(float(np.median(residuals)), float(np.finfo(float).tiny))
    return np.asarray(1.0 / np.maximum(residuals / median, SMALLEST_RESIDUAL))


def _along_tree(
    edges: IntArray, maps: FloatArray, num_shapes: int, weights: FloatArray
) -> FloatArray:
    """Return bases that agree with the maps of the most trusted spanning tree."""
    graph = nx.Graph()
    graph.add_nodes_from(range(num_shapes))
    for e, (target, source) in enumerate(edges.tolist()):
        graph.add_edge(target, source, number=e, trust=float(weights[e]))
    tree = nx.maximum_spanning_tree(graph, weight="trust")
    if not nx.is_connected(tree):
        raise ValueError("the maps do not connect the shapes")
    size = maps.shape[-1]
    bases = np.tile(np.eye(size), (num_shapes, 1, 1))
    for known, new in nx.bfs_edges(tree, 0):
        e = tree[known][new]["number"]
        step = maps[e] if edges[e, 0] == known else maps[e].T
        bases[new] = nearest_orthogonal(step @ bases[known])
    return bases


def _power_iteration(
    edges: IntArray, maps: FloatArray, bases: FloatArray, weights: FloatArray
) -> FloatArray:
    """Return the bases after steps of averaging what maps ask for and taking the nearest orthogonal blocks."""
    target, source = edges[:, 0], edges[:, 1]
    weighted = weights[:, None, None] * maps
    for _ in range(MAX_STEPS):
        sums = np.zeros_like(bases)
        asked = (
            zip(source, weighted @ bases[target], strict=True),
            zip(target, np.swapaxes(weighted, 1, 2) @ bases[source], strict=True),
        )
        for shape, block in chain.from_iterable(asked):  # np.add.at takes as long as the products
            sums[shape] += block
        before, bases = bases, nearest_orthogonal(sums)
        if float(np.abs(bases - before).max()) < TOLERANCE:
            break
    return bases


#: Log-odds that a candidate map loses per unit of the logarithm of its residual, the number of functions in which
#: candidates are compared, and rounds of choosing.
CYCLE_WEIGHT, NUM_COMPARED, MAX_CHOICE_ROUNDS = 4.0, 30, 8


def choose_maps(
    edges: IntArray,
    candidates: Sequence[FloatArray],
    log_odds: Sequence[FloatArray],
    num_shapes: int,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Choose one candidate map for each pair, and return the common bases of those.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
        They connect all shapes.
    candidates : sequence of E ndarray (m, k, k)
        ``C_source_target`` of each candidate, the likeliest first; k at least :data:`NUM_COMPARED` or the same for
        all.
    log_odds : sequence of E ndarray (m,)
        By the pair's own evidence, up to a constant of the pair.
    num_shapes : int

    Returns
    -------
    choice : ndarray of int, shape (E,)
    bases, residuals : ndarray
        Of the chosen maps in their lowest functions, see :func:`common_bases`.
    """
    size = min(NUM_COMPARED, *(maps.shape[-1] for maps in candidates))
    low = [maps[:, :size, :size] for maps in candidates]
    choice = np.array([int(np.argmax(odds)) for odds in log_odds])
    weights = np.array([_certainty(odds) for odds in log_odds])
    bases, residuals = _bases_of(edges, low, choice, num_shapes, weights)
    for _ in range(MAX_CHOICE_ROUNDS):
        better = choice.copy()
        for pair, (edge, maps, odds) in enumerate(zip(edges, low, log_odds, strict=True)):
            gaps = map_residuals(np.tile(edge, (len(maps), 1)), maps, bases)
            better[pair] = np.argmax(odds - CYCLE_WEIGHT * np.log(np.maximum(gaps, FLOOR)))
        if (better == choice).all():
            break
        choice = better
        bases, residuals = _bases_of(edges, low, choice, num_shapes, weights)
    return choice, bases, residuals


def _bases_of(
    edges: IntArray,
    maps: Sequence[FloatArray],
    choice: IntArray,
    num_shapes: int,
    weights: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    chosen = np.stack([own[c] for own, c in zip(maps, choice, strict=True)])
    return common_bases(edges, chosen, num_shapes, weights)


def _certainty(log_odds: FloatArray) -> float:
    """Return the probability of the likeliest candidate against the others."""
    chances = np.exp(log_odds - log_odds.max())
    return float(1.0 / chances.sum())
