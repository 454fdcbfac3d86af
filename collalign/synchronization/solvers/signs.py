"""Which shapes are mirrored: Z_2 synchronization of the signs of determinants, with its own certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix, diags, identity

from collalign.synchronization.problem.graph import PairGraph
from collalign.synchronization.solvers.belief_propagation import conditional_moves, propagate_beliefs
from collalign.synchronization.solvers.spectral import leading_eigenvectors
from data_tools.arrays import BoolArray, FloatArray, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Beliefs start from the signs of the eigenvector, right and wrong with these probabilities, and may take so many
#: rounds (set on simulations: tests/benchmarks/bench_synchronization.py chirality).
FIRST_BELIEFS, MAX_ROUNDS = (0.9, 0.1), 200

#: Half the log-odds of a sign where nothing is known about it: one in ten is wrong.
DEFAULT_TRUST = 0.5 * np.log(9.0)

#: A minimum eigenvalue above ``-CERTIFIED_TOL`` times the largest degree counts as zero.
CERTIFIED_TOL = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class ChiralityResult:
    """Signs of the shapes, relative to the first shape of their group.

    Attributes
    ----------
    mirrored : ndarray of bool, shape (N,)
        False for the first shape of each connected group.
    confidence : ndarray, shape (N,)
        Probability that the sign is right, given that of the group's best connected shape.
    contradicted : ndarray of bool, shape (E,)
        Pairs whose sign disagrees.
    min_eigenvalue : float
        Of ``Lambda - W``: not negative (to rounding) proves that no other signs agree with more evidence.
    optimal : bool
    """

    mirrored: BoolArray
    confidence: FloatArray
    contradicted: BoolArray
    min_eigenvalue: float
    optimal: bool


@one_blas_thread()
def synchronize_signs(
    edges: ArrayLike, signs: ArrayLike, *, weights: ArrayLike | None = None, num_shapes: int | None = None
) -> ChiralityResult:
    """Find the sign of every shape from signs of pairs that are partly wrong.

    Maximises ``sum_e w_e s_e x_i x_j`` over signs x: eigenvector of the signed adjacency (Cucuringu 2015), beliefs,
    single moves; certified as a rotation synchronization in one dimension.

    Parameters
    ----------
    edges : array_like of int, shape (E, 2)
    signs : array_like, shape (E,)
        +1 or -1 each, for instance the determinants of the pairs' rotations.
    weights : array_like, shape (E,), optional
        Log-odds that the pair's sign is right, divided by two; those of a tenth wrong by default.
    num_shapes : int, optional

    Raises
    ------
    InputError
        If a sign is not 1 or -1, or the edges are not pairs of shapes.
    """
    given = np.asarray(signs, dtype=np.float64)
    if given.ndim != 1 or not np.isin(given, (-1.0, 1.0)).all():
        raise InputError("signs: expected +1 or -1 for each pair")
    trust = np.full(len(given), DEFAULT_TRUST) if weights is None else weights
    graph = PairGraph.from_user(edges, given[:, None, None], weights=trust, group="O", num_shapes=num_shapes)
    found, confidence = np.ones(graph.num_shapes), np.ones(graph.num_shapes)
    smallest, optimal = 0.0, True
    for members in graph.connected_components():
        part, kept = graph.subgraph(members)
        if not part.num_edges:
            continue
        evidence = part.weights * given[kept]
        own, sure = _signs_of_group(part, evidence)
        found[members], confidence[members] = own * own[0], sure
        eigenvalue, scale = _min_eigenvalue(part, evidence, own)
        smallest, optimal = min(smallest, eigenvalue), optimal and eigenvalue >= -CERTIFIED_TOL * scale
    left, right = graph.edges.T
    return ChiralityResult(
        mirrored=read_only(found < 0),
        confidence=read_only(confidence),
        contradicted=read_only(given * found[left] * found[right] < 0),
        min_eigenvalue=smallest,
        optimal=bool(optimal),
    )


def _signs_of_group(graph: PairGraph, evidence: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return signs and their probabilities for a connected group."""
    left, right = graph.edges.T
    count = graph.num_shapes
    matrix = coo_matrix((evidence, (left, right)), shape=(count, count))
    size = np.bincount(graph.edges.ravel(), weights=np.repeat(np.abs(evidence), 2), minlength=count)
    scale = diags(1.0 / np.sqrt(np.maximum(size, 1e-300)))
    _, vector = leading_eigenvectors((scale @ (matrix + matrix.T) @ scale + identity(count)).tocsr(), 1)
    start = np.where(vector[:, 0] >= 0, 1.0, -1.0)
    turned = evidence * start[left] * start[right]
    costs = turned[:, None, None] * np.array([[-1.0, 1.0], [1.0, -1.0]])
    hub = np.array([np.argmax(size)])
    beliefs = propagate_beliefs(
        graph.edges, costs, count, start=np.tile(FIRST_BELIEFS, (count, 1)), fixed=hub, max_rounds=MAX_ROUNDS
    )
    options = [np.argmax(beliefs, axis=1), np.zeros(count, dtype=np.int64)]
    free = np.ones(count, dtype=bool)
    settled = [conditional_moves(graph.edges, costs, labels, free=free) for labels in options]
    signs = [1.0 - 2.0 * labels for labels in settled]
    best = int(np.argmax([np.sum(turned * x[left] * x[right]) for x in signs]))
    chosen = settled[best]
    return start * signs[best], beliefs[np.arange(count), chosen]


def _min_eigenvalue(graph: PairGraph, evidence: FloatArray, signs: FloatArray) -> tuple[float, float]:
    """Return the smallest eigenvalue of ``Lambda - W``, residual subtracted, and the scale of Lambda."""
    left, right = graph.edges.T
    count = graph.num_shapes
    matrix = coo_matrix((evidence, (left, right)), shape=(count, count))
    matrix = (matrix + matrix.T).tocsr()
    multipliers = signs * (matrix @ signs)
    scale = max(float(np.abs(multipliers).max()), 1e-300)
    shifted = (matrix - diags(multipliers)) / scale
    values, vectors = leading_eigenvectors((shifted + identity(count)).tocsr(), 1)
    residual = float(np.linalg.norm(shifted @ vectors[:, -1] + (1.0 - values[-1]) * vectors[:, -1]))
    return scale * float(1.0 - values[-1] - residual), scale
