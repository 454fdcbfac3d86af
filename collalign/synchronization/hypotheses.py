"""The discrete side of poses: rotations of the common frame that pairs propose, and belief propagation among them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collalign.synchronization.graph import PairGraph
from collalign.synchronization.model import PRIORS, EdgeModel
from data_tools.arrays import BoolArray, FloatArray, IntArray, sums_by_owner
from data_tools.poses import APART_DEG

#: Rounds of messages at most; they have settled when none changes by more.
MAX_MESSAGE_ROUNDS, MESSAGE_TOL = 60, 1e-3

#: Part of the old message kept at each round.
DAMPING = 0.4


def propagate_beliefs(
    edges: IntArray, costs: FloatArray, *, start: FloatArray, fixed: BoolArray
) -> FloatArray:
    """Return sum-product marginals of the rotations, shape (N, L).

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    costs : ndarray, shape (E, L, L)
        Minus log-likelihood of each combination of rotations.
    start : ndarray, shape (N, L)
        Beliefs to start from.
    fixed : ndarray of bool, shape (N,)
        Shapes that stay at rotation 0: they break the symmetry of the gauge. Their own marginals are what the others
        say.
    """
    count, size = costs.shape[:2]
    likelihood = np.exp(-(costs - costs.min(axis=(1, 2), keepdims=True)))
    kernel = np.concatenate([likelihood, np.swapaxes(likelihood, 1, 2)])
    source, target = edges.T.ravel(), edges[:, ::-1].T.ravel()
    reverse = np.concatenate([np.arange(count, 2 * count), np.arange(count)])
    at_identity = np.where(np.arange(size) == 0, 1.0, 0.0)
    messages = np.zeros((2 * count, size))
    cavity = start[source]
    for _ in range(MAX_MESSAGE_ROUNDS):
        cavity[fixed[source]] = at_identity
        fresh = np.log(np.maximum((cavity[:, None, :] @ kernel)[:, 0], 1e-300))
        fresh -= fresh.max(axis=1, keepdims=True)
        mixed = fresh if _ == 0 else DAMPING * messages + (1.0 - DAMPING) * fresh
        change = float(np.abs(np.exp(mixed) - np.exp(messages)).max(initial=0.0))
        messages = mixed
        field = sums_by_owner(messages, target, len(start))
        cavity = _softmax(field[source] - messages[reverse])
        if change < MESSAGE_TOL:
            break
    return _softmax(sums_by_owner(messages, target, len(start)))


def _softmax(field: FloatArray) -> FloatArray:
    raised = np.exp(field - field.max(axis=1, keepdims=True))
    return raised / raised.sum(axis=1, keepdims=True)


#: Rotations closer than this (squared Frobenius distance of :data:`APART_DEG`) are one rotation.
SAME_ROTATION = 8.0 * np.sin(np.deg2rad(APART_DEG / 2.0)) ** 2

#: Rotations per shape, L, at most, the identity and those of the whole collection among them; the latter, at most.
MAX_HYPOTHESES, MAX_GLOBAL = 6, 3

#: Cost of a rotation that is not offered.
FORBIDDEN = 1e4

#: Bandwidths of the kernel in which rotations are counted, of one shape and of all, and the squared distance within
#: which a pair is wrong by a rotation, in units of the noise's variance (set on planted graphs:
#: experiments/peers/synchronization.py).
SHAPE_BANDWIDTH, GLOBAL_BANDWIDTH, FLIP_REACH = 4.0, 8.0, 36.0

#: The global density is a sum over this many rotations per proposal, at most.
ROTATIONS_PER_PROPOSAL = 4

#: Proposals looked at per shape, and for the whole collection, at most.
SHAPE_PROPOSALS, GLOBAL_PROPOSALS = 48, 400


def aligned_candidates(graph: PairGraph, frames: FloatArray) -> FloatArray:
    """Return ``P_i^T R_k P_j``, the identity for a consistent candidate, shape (E, m, d, d)."""
    left, right = frames[graph.edges[:, 0]], frames[graph.edges[:, 1]]
    return np.swapaxes(left, 1, 2)[:, None] @ graph.candidates @ right[:, None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypotheses:
    """The discrete alternatives of every shape.

    Attributes
    ----------
    rotations : ndarray, shape (N, L, d, d)
        Rotations ``T`` of each shape, the identity first: ``P_i T`` are its candidate poses. Shapes with fewer than L
        repeat the identity.
    offered : ndarray of bool, shape (N, L)
        False for the repetitions.
    common : ndarray, shape (G, d, d)
        Rotations that many pairs propose, the same for all shapes; they follow the identity in ``rotations``.
    rates : ndarray, shape (G,)
        Share of the pairs whose best candidate is wrong by that rotation and that have no right one.
    explained : ndarray, shape (E,)
        Probability that each pair has a right candidate or is wrong by a common rotation.
    """

    rotations: FloatArray
    offered: BoolArray
    common: FloatArray
    rates: FloatArray
    explained: FloatArray


def propose_hypotheses(model: EdgeModel, aligned: FloatArray) -> Hypotheses:
    """Return rotations ``T`` of each shape, the identity first, so that ``P_i T`` are its candidate poses.

    The modes of all pairs' rotations come first, because a block of shapes can rotate as one only by a rotation that
    all its members have; then the modes of the shape's own pairs that are not among them.

    Parameters
    ----------
    model : EdgeModel
    aligned : ndarray, shape (E, m, d, d)
        From :func:`aligned_candidates`.
    """
    graph = model.graph
    common = common_rotations(model, aligned, MAX_GLOBAL)
    rotations = np.tile(np.eye(graph.dim), (graph.num_shapes, MAX_HYPOTHESES, 1, 1))
    rotations[:, 1 : 1 + len(common)] = common
    offered = np.zeros(rotations.shape[:2], dtype=bool)
    offered[:, : 1 + len(common)] = True
    right = model.responsibilities(((aligned - np.eye(graph.dim)) ** 2).sum(axis=(2, 3))).sum(
        axis=1
    )
    flipped = _flipped_pairs(model, aligned, common, right)
    explained = right + flipped.sum(axis=1)
    _add_own_hypotheses(model, aligned, rotations, offered, 1 + len(common), explained)
    used = max(int(offered.sum(axis=1).max()), 2)
    return Hypotheses(
        rotations=rotations[:, :used],
        offered=offered[:, :used],
        common=common,
        rates=(flipped.sum(axis=0) + PRIORS.flipped) / (graph.num_edges + 1.0),
        explained=explained,
    )


def _add_own_hypotheses(
    model: EdgeModel,
    aligned: FloatArray,
    rotations: FloatArray,
    offered: BoolArray,
    known: int,
    explained: FloatArray,
) -> None:
    """Write into ``rotations`` the modes that the pairs of each shape propose.

    Its pose and the common rotations are not among them. Shapes whose pairs are nearly all explained by those have
    none.
    """
    graph = model.graph
    owner, edge, side = _incidence(graph)
    starts = np.searchsorted(owner, np.arange(graph.num_shapes + 1))
    share = np.bincount(owner, weights=explained[edge], minlength=graph.num_shapes) / np.maximum(
        np.diff(starts), 1
    )
    chance = np.exp(model.log_prior)
    for shape in np.flatnonzero(share < PRIORS.explained_share):
        part = slice(starts[shape], starts[shape + 1])
        mine = aligned[edge[part]]
        mine = np.where(side[part][:, None, None, None] == 0, mine, np.swapaxes(mine, 2, 3))
        own = _modes(
            mine.reshape(-1, graph.dim, graph.dim),
            chance[edge[part]].ravel(),
            SHAPE_BANDWIDTH * model.noise_rad**2,
            rotations.shape[1] - known,
            rotations[shape, :known],
            SHAPE_PROPOSALS,
        )
        rotations[shape, known : known + len(own)] = own
        offered[shape, known : known + len(own)] = True
    fresh = offered.copy()
    fresh[:, :known] = False
    rotations[fresh] = graph.pattern.project(rotations[fresh])


def common_rotations(model: EdgeModel, aligned: FloatArray, count: int) -> FloatArray:
    """Return the most frequent rotations over all pairs, in both directions, shape (at most count, d, d)."""
    graph = model.graph
    flat = aligned.reshape(-1, graph.dim, graph.dim)
    chance = np.exp(model.log_prior).ravel()
    far = ((flat - np.eye(graph.dim)) ** 2).sum(axis=(1, 2)) > SAME_ROTATION
    far &= chance > 0
    chosen = np.flatnonzero(far)
    most = ROTATIONS_PER_PROPOSAL * GLOBAL_PROPOSALS
    if len(chosen) > most:
        chosen = chosen[np.linspace(0, len(chosen) - 1, most).astype(np.int64)]
    both = np.concatenate([flat[chosen], np.swapaxes(flat[chosen], 1, 2)])
    weights = np.tile(chance[chosen], 2)
    known = np.eye(graph.dim)[None]
    means = _modes(
        both, weights, GLOBAL_BANDWIDTH * model.noise_rad**2, count, known, GLOBAL_PROPOSALS
    )
    return graph.pattern.project(means)


def _modes(
    rotations: FloatArray,
    weights: FloatArray,
    bandwidth: float,
    count: int,
    known: FloatArray,
    num_proposals: int,
) -> FloatArray:
    """Return the strongest modes of weighted rotations, none near a known one or another, (at most count, d, d).

    Kernel density at the proposals (the heaviest, evenly thinned), greedy with suppression. Each mode is the sum of
    the rotations by its kernel, one step of mean shift before it is projected onto the group.
    """
    dim = rotations.shape[-1]
    flat = rotations.reshape(len(rotations), dim * dim)
    distance = 2.0 * dim - 2.0 * flat @ known.reshape(len(known), -1).T
    proposals = np.flatnonzero(
        (distance.min(axis=1, initial=np.inf) > SAME_ROTATION) & (weights > 0)
    )
    if len(proposals) > num_proposals:
        proposals = proposals[np.linspace(0, len(proposals) - 1, num_proposals).astype(np.int64)]
    kernel = np.exp(-(2.0 * dim - 2.0 * flat[proposals] @ flat.T) / (4.0 * bandwidth)) * weights
    density = kernel.sum(axis=1)
    found: list[FloatArray] = []
    while len(found) < count and len(proposals) and density.max() > 0:
        top = int(np.argmax(density))
        found.append((kernel[top] @ flat).reshape(dim, dim))
        density[2.0 * dim - 2.0 * flat[proposals] @ flat[proposals[top]] <= SAME_ROTATION] = 0.0
    return np.array(found).reshape(-1, dim, dim)


def _incidence(graph: PairGraph) -> tuple[IntArray, IntArray, IntArray]:
    """Return shape, edge and side of every end of an edge, sorted by shape."""
    owner = graph.edges.T.ravel()
    edge = np.tile(np.arange(graph.num_edges), 2)
    side = np.repeat([0, 1], graph.num_edges)
    order = np.argsort(owner, kind="stable")
    return owner[order], edge[order], side[order]


def _flipped_pairs(
    model: EdgeModel, aligned: FloatArray, common: FloatArray, right: FloatArray
) -> FloatArray:
    """Return the probability that each pair is wrong by each common rotation, shape (E, G).

    Parameters
    ----------
    model : EdgeModel
    aligned : ndarray, shape (E, m, d, d)
    common : ndarray, shape (G, d, d)
    right : ndarray, shape (E,)
        Probability that one of the pair's candidates is right.
    """
    graph = model.graph
    if not len(common):
        return np.zeros((graph.num_edges, 0))
    best = aligned[np.arange(graph.num_edges), graph.best_choice].reshape(graph.num_edges, -1)
    both = np.stack([common, np.swapaxes(common, 1, 2)]).reshape(2 * len(common), -1)
    squared = (
        (2.0 * graph.dim - 2.0 * best @ both.T).reshape(graph.num_edges, 2, len(common)).min(axis=1)
    )
    near = squared <= np.minimum(SAME_ROTATION, FLIP_REACH * model.noise_rad**2)
    wrong = np.maximum(1.0 - right, 0.0) * ~graph.fixed
    return wrong[:, None] * near / np.maximum(near.sum(axis=1, keepdims=True), 1)


def hypothesis_costs(model: EdgeModel, aligned: FloatArray, alternatives: Hypotheses) -> FloatArray:
    """Return each pair's cost for every combination of its shapes' rotations, shape (E, L, L).

    A pair without a right candidate is not wrong in any way alike: where shapes are nearly symmetric it is wrong by
    one of the common rotations, at the estimated rates. Without these terms two pairs that are wrong in the same way
    would count as proof of each other.

    Parameters
    ----------
    model : EdgeModel
    aligned : ndarray, shape (E, m, d, d)
        From :func:`aligned_candidates`.
    alternatives : Hypotheses
        A rotation that is not offered costs ``FORBIDDEN`` at every pair.
    """
    graph = model.graph
    first, second = graph.edges.T
    costs = model.costs(_rotated_distances(graph, aligned, alternatives))
    best = aligned[np.arange(graph.num_edges), graph.best_choice][:, None]
    for flip, rate in _directed_flips(alternatives):
        apart = _rotated_distances(graph, best, alternatives, flip=flip)[:, 0]
        log_flip = np.log(rate) - apart / (4.0 * model.variances[:, None, None])
        costs = -np.logaddexp(-costs, np.where(graph.fixed[:, None, None], -np.inf, log_flip))
    left_out, right_out = ~alternatives.offered[first], ~alternatives.offered[second]
    if not (left_out.any() or right_out.any()):
        return costs
    return np.where(left_out[:, :, None] | right_out[:, None], FORBIDDEN, costs)


def _rotated_distances(
    graph: PairGraph,
    aligned: FloatArray,
    alternatives: Hypotheses,
    *,
    flip: FloatArray | None = None,
) -> FloatArray:
    """Return ``|T_a^T A T_b - F|^2`` for all rotations a, b of a pair's shapes, shape (E, m, L, L).

    F is the identity unless it is given. ``tr F^T T_a^T A T_b`` is the inner product of A with ``T_a F T_b^T``: one
    product for all pairs where they share their rotations.
    """
    size, num = graph.dim**2, alternatives.rotations.shape[1]
    flat = aligned.reshape(*aligned.shape[:2], size)
    if num == 1 + len(alternatives.common):
        shared = alternatives.rotations[0]
        left = shared if flip is None else shared @ flip
        inner = flat @ (left[:, None] @ np.swapaxes(shared, 1, 2)).reshape(num * num, size).T
    else:
        left = alternatives.rotations if flip is None else alternatives.rotations @ flip
        rotated = (
            left[graph.edges[:, 0]][:, :, None]
            @ np.swapaxes(alternatives.rotations, 2, 3)[graph.edges[:, 1]][:, None]
        )
        inner = flat @ np.swapaxes(rotated.reshape(graph.num_edges, num * num, size), 1, 2)
    squared = 2.0 * graph.dim - 2.0 * inner
    return np.maximum(squared, 0.0, out=squared).reshape(*aligned.shape[:2], num, num)


def _directed_flips(alternatives: Hypotheses) -> list[tuple[FloatArray, float]]:
    """Return the common rotations that happen, and their inverses where these differ, with their rates."""
    flips: list[tuple[FloatArray, float]] = []
    for rotation, rate in zip(alternatives.common, alternatives.rates, strict=True):
        if rate < PRIORS.rare_flip:
            continue
        if ((rotation - rotation.T) ** 2).sum() <= SAME_ROTATION:
            flips.append((rotation, float(rate)))
        else:
            flips += [(rotation, rate / 2.0), (rotation.T, rate / 2.0)]
    return flips
