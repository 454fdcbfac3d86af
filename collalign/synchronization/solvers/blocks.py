"""Blocks of shapes that could turn as one: the weakest cuts of a component, and what the pairs across them say."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, diags, identity

from collalign.synchronization.problem.graph import PairGraph
from collalign.synchronization.problem.priors import PRIORS
from collalign.synchronization.result import WeakCut
from collalign.synchronization.solvers.spectral import leading_eigenvectors
from data_tools.arrays import BoolArray, FloatArray, IntArray

#: A block is doubted when more than this share of the votes across the cut speak against it, and more than among all
#: votes about the same turn, by ``SPIN_GLASS sqrt(N) + 1`` standard deviations. The best of all blocks of a random
#: graph reaches .76 sqrt(N) (the ground state of the Sherrington-Kirkpatrick model), and is no evidence.
DOUBTED_SHARE, SPIN_GLASS = 0.25, 0.76

#: Orders of the shapes, by slow vectors of the signed Laplacian, along which blocks are looked for.
NUM_SLOW = 4

#: Smaller components have no blocks: two shapes against two are the least.
LEAST_SHAPES = 4

#: Moving a shape over a cut gains when the cost falls by more than this, nats: less is rounding.
GAIN_TOL = 1e-9


def turn_differences(costs: FloatArray, num_common: int) -> FloatArray:
    """Return what turning one end of each pair by each common turn costs, shape (G, E).

    Parameters
    ----------
    costs : ndarray, shape (E, L, L)
        From :func:`turn_costs`; the common turns follow the identity.
    num_common : int
        G.
    """
    turned = slice(1, 1 + num_common)
    single = (costs[:, turned, 0] + costs[:, 0, turned]) / 2.0 - costs[:, :1, 0]
    return np.ascontiguousarray(single.T)


def weak_cuts(graph: PairGraph, differences: FloatArray, common: FloatArray, fixed: BoolArray) -> list[WeakCut]:
    """Return the weakest blocks of a group under each common turn, the doubted ones first.

    Two blocks per turn: the one that the pairs contradict in the most structured way, and the one that is cheapest
    to turn. Blocks hold at most half of the shapes, and none that may not turn; single shapes are left to their own
    beliefs.

    Parameters
    ----------
    graph : PairGraph
        Connected.
    differences : ndarray, shape (G, E)
        From :func:`turn_differences`.
    common : ndarray, shape (G, d, d)
    fixed : ndarray of bool, shape (N,)
        Shapes that may not turn.
    """
    cuts: list[WeakCut] = []
    if graph.num_shapes < LEAST_SHAPES:
        return cuts
    for costs, turn in zip(differences, common, strict=True):
        order = _slow_orders(graph.edges, costs, graph.num_shapes)
        structured = _most_contradicted(graph, costs, order)
        cheapest = _settled(graph.edges, costs, _sweep(graph.edges, costs, order), minimum=2)
        cheapest = cheapest & _holds_together(graph.edges, costs, cheapest)
        for block in (structured, cheapest):
            side = _turned_side(block, fixed)
            if side is not None and side.sum() > 1:
                cuts.append(_judged(graph, costs, turn, side))
    return sorted(cuts, key=lambda cut: (not cut.doubted, -len(cut.members) if cut.doubted else cut.log_odds))


def _slow_orders(edges: IntArray, costs: FloatArray, num_shapes: int) -> IntArray:
    """Return the shapes' ranks along the slowest vectors of the signed Laplacian, shape (NUM_SLOW, N)."""
    left, right = edges.T
    weights = coo_matrix((costs, (left, right)), shape=(num_shapes, num_shapes))
    weights = (weights + weights.T).tocsr()
    size = np.asarray(abs(weights).sum(axis=1)).ravel()
    scale = 1.0 / np.sqrt(np.maximum(size, 1e-9 * max(size.max(initial=0.0), 1e-12)))
    signed = np.asarray(weights.sum(axis=1)).ravel()
    operator = diags(scale) @ (weights - diags(signed)) @ diags(scale) + identity(num_shapes, format="csr")
    _, vectors = leading_eigenvectors(operator.tocsr(), min(NUM_SLOW + 1, num_shapes))
    return np.argsort(np.argsort(vectors * scale[:, None], axis=0, kind="stable"), axis=0, kind="stable").T


def _prefix_sums(edges: IntArray, values: FloatArray, rank: IntArray) -> FloatArray:
    """Return the sum of the values across each cut of the shapes of rank below 2, 3, ... N - 2."""
    count = len(rank)
    low, high = np.sort(rank[edges], axis=1).T
    opened = np.bincount(low, weights=values, minlength=count)
    closed = np.bincount(high, weights=values, minlength=count)
    return np.cumsum(opened - closed)[1 : count - 2]


def _sweep(edges: IntArray, costs: FloatArray, orders: IntArray) -> BoolArray:
    """Return the block of least cost across the cut for the size of its smaller side."""
    sizes = np.arange(2, orders.shape[1] - 1)
    ratios = [_prefix_sums(edges, costs, rank) / np.minimum(sizes, orders.shape[1] - sizes) for rank in orders]
    which, place = np.unravel_index(int(np.argmin(ratios)), (len(orders), len(sizes)))
    return orders[which] < sizes[place]


def _most_contradicted(graph: PairGraph, costs: FloatArray, orders: IntArray) -> BoolArray:
    """Return the block across whose cut most pairs speak for the turn, beyond the rate within its sides.

    The sweep's best cut starts a two-block stochastic block model: pairs contradict at one rate within the sides, at
    another across; single shapes change sides while the likelihood grows.
    """
    against, clear = (costs < -PRIORS.clear_vote).astype(float), (np.abs(costs) > PRIORS.clear_vote).astype(float)
    best, best_excess = orders[0] < 2, -np.inf
    sizes = np.arange(2, orders.shape[1] - 1)
    for rank in orders:
        excess = _excess(
            _prefix_sums(graph.edges, against, rank),
            _prefix_sums(graph.edges, clear, rank),
            against.sum(),
            clear.sum(),
        )
        if excess.max() > best_excess:
            best, best_excess = rank < sizes[int(np.argmax(excess))], float(excess.max())
    cut = best[graph.edges[:, 0]] != best[graph.edges[:, 1]]
    rates = [(against[s].sum() + 0.5) / (clear[s].sum() + 1.0) for s in (cut, ~cut)]
    gain = np.where(against > 0, np.log(rates[0] / rates[1]), np.log((1.0 - rates[0]) / (1.0 - rates[1])))
    return _settled(graph.edges, -gain * clear, best, minimum=1)


def _excess(against: FloatArray, clear: FloatArray, all_against: float, all_clear: float) -> FloatArray:
    """Return by how many standard deviations votes against exceed their rate among all votes."""
    rate = (all_against + 0.5) / (all_clear + 1.0)
    return (against - rate * clear) / np.sqrt(rate * (1.0 - rate) * np.maximum(clear, 1.0))


def _settled(edges: IntArray, costs: FloatArray, block: BoolArray, *, minimum: int) -> BoolArray:
    """Return the block after greedy single moves that lower the cut's cost, neither side ever below the minimum."""
    count = len(block)
    matrix = coo_matrix((costs, (edges[:, 0], edges[:, 1])), shape=(count, count))
    matrix = (matrix + matrix.T).tocsr()
    side = np.where(block, 1.0, -1.0)
    field = matrix @ side
    for _ in range(count):
        sizes = np.where(side > 0, (side > 0).sum(), (side < 0).sum())
        gain = np.where(sizes > minimum, -side * field, -np.inf)
        moving = int(np.argmax(gain))
        if gain[moving] <= GAIN_TOL:
            break
        part = slice(matrix.indptr[moving], matrix.indptr[moving + 1])
        field[matrix.indices[part]] -= 2.0 * side[moving] * matrix.data[part]
        side[moving] *= -1.0
    return side > 0


def _holds_together(edges: IntArray, costs: FloatArray, block: BoolArray) -> bool:
    """Whether the block is more than one weak shape with arbitrary company."""
    alone = _settled(edges, costs, block, minimum=1)
    return min(int(alone.sum()), int((~alone).sum())) > 1


def _turned_side(block: BoolArray, fixed: BoolArray) -> BoolArray | None:
    """Return the side that would turn: the smaller one, or the one without fixed shapes; None if both have some."""
    side = block if block.sum() <= len(block) / 2 else ~block
    if (side & fixed).any():
        side = ~side
    return None if (side & fixed).any() else side


def _judged(graph: PairGraph, costs: FloatArray, turn: FloatArray, block: BoolArray) -> WeakCut:
    across = block[graph.edges[:, 0]] != block[graph.edges[:, 1]]
    against, clear = costs < -PRIORS.clear_vote, np.abs(costs) > PRIORS.clear_vote
    votes, votes_against = int((clear & across).sum()), int((against & across).sum())
    excess = float(_excess(np.array(float(votes_against)), np.array(float(votes)), against.sum(), clear.sum()))
    structured = votes_against > DOUBTED_SHARE * votes and excess > SPIN_GLASS * np.sqrt(graph.num_shapes) + 1.0
    log_odds = float(costs[across].sum())
    return WeakCut(
        members=np.flatnonzero(block),
        rotation=turn,
        log_odds=log_odds,
        pairs_for=votes - votes_against,
        pairs_against=votes_against,
        structured=bool(structured),
        doubted=bool(structured or log_odds < PRIORS.doubted_log_odds),
    )
