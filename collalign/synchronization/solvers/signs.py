"""Which shapes are mirrored: Z_2 synchronization of the signs of determinants, by an eigenvector and single moves."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, diags, identity

from collalign.synchronization.problem.graph import PairGraph
from collalign.synchronization.solvers.spectral import leading_eigenvectors
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.threads import one_blas_thread

#: A move that gains less than this part of a pair's evidence gains nothing.
_ROUNDING = 1e-9


@one_blas_thread()
def synchronize_signs(edges: IntArray, signs: FloatArray, weights: FloatArray, num_shapes: int) -> BoolArray:
    """Return which shapes are mirrored, from signs of pairs that are partly wrong, shape (N,).

    Maximises ``sum_e w_e s_e x_i x_j`` over signs x: eigenvector of the signed adjacency (Cucuringu 2015), then the
    single moves that gain most. The first shape of every component counts as not mirrored.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    signs : ndarray, shape (E,)
        +1 or -1 each, for instance the determinants of the pairs' rotations.
    weights : ndarray, shape (E,)
        Log-odds that the pair's sign is right, divided by two.
    num_shapes : int

    Raises
    ------
    InputError
        If a sign is not 1 or -1, or the edges are not pairs of shapes.
    """
    graph = PairGraph.from_user(edges, signs[:, None, None], weights=weights, group="O", num_shapes=num_shapes)
    found = np.ones(graph.num_shapes)
    for members in graph.connected_components():
        part, kept = graph.subgraph(members)
        if part.num_edges:
            own = _signs_of_component(part, part.weights * signs[kept])
            found[members] = own * own[0]
    return found < 0


def _signs_of_component(graph: PairGraph, evidence: FloatArray) -> FloatArray:
    """Return the signs of a component."""
    left, right = graph.edges.T
    count = graph.num_shapes
    matrix = coo_matrix((evidence, (left, right)), shape=(count, count))
    size = np.bincount(graph.edges.ravel(), weights=np.repeat(np.abs(evidence), 2), minlength=count)
    scale = diags(1.0 / np.sqrt(np.maximum(size, 1e-300)))
    _, vector = leading_eigenvectors((scale @ (matrix + matrix.T) @ scale + identity(count)).tocsr(), 1)
    signs = np.where(vector[:, 0] >= 0, 1.0, -1.0)
    both = (matrix + matrix.T).tocsr()
    agreed = signs * (both @ signs)
    while agreed.min() < -_ROUNDING * np.abs(evidence).max():
        signs[np.argmin(agreed)] *= -1.0
        agreed = signs * (both @ signs)
    return signs
