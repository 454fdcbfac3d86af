"""The equations of large collections: solved on chains, grids and random graphs, whatever the weights."""

import networkx as nx
import numpy as np
import pytest

from collalign.synchronization import averaging
from collalign.synchronization.averaging import _solve_laplacian
from collalign.synchronization.spectral import DENSE_LIMIT
from data_tools.surface.laplacian import factor_symmetric

GRAPHS = {
    "chain": nx.path_graph(900),
    "grid": nx.convert_node_labels_to_integers(nx.grid_2d_graph(30, 30)),
    "random": nx.random_regular_graph(8, 900, seed=0),
    "forest": nx.disjoint_union(nx.random_labeled_tree(500, seed=1), nx.path_graph(400)),
}


def problem(kind, spread):
    """Pairs, weights over so many orders of magnitude, free shapes (one per component is not) and forces."""
    graph, rng = GRAPHS[kind], np.random.default_rng(2)
    edges = np.array(sorted(graph.edges), dtype=np.int64)
    free = np.ones(len(graph), dtype=bool)
    free[[min(part) for part in nx.connected_components(graph)]] = False
    return (
        edges,
        10.0 ** rng.uniform(-spread, 0.0, len(edges)),
        free,
        rng.standard_normal((int(free.sum()), 3)),
    )


def laplacian(edges, weights, free):
    matrix = np.zeros((len(free), len(free)))
    for (i, j), weight in zip(edges, weights, strict=True):
        matrix[[i, j], [i, j]] += weight
        matrix[[i, j], [j, i]] -= weight
    return matrix[np.ix_(free, free)]


@pytest.mark.parametrize("spread", [0.0, 3.0])
@pytest.mark.parametrize("kind", GRAPHS)
def test_large_laplacians_are_solved(kind, spread):
    edges, weights, free, force = problem(kind, spread)
    assert len(free) > DENSE_LIMIT
    matrix = laplacian(edges, weights, free)
    exact = np.linalg.solve(matrix, force)
    error = _solve_laplacian(edges, weights, len(free), free, force) - exact
    energies = [np.einsum("nc,nm,mc->c", x, matrix, x) for x in (error, exact)]
    assert (energies[0] <= 1e-3 * energies[1]).all()


@pytest.mark.parametrize("spread", [0.0, 3.0, 9.0])
def test_graphs_with_random_pairs_are_never_factored(spread, monkeypatch):
    sizes = []

    def counted(matrix):
        factor = factor_symmetric(matrix)
        sizes.append(factor.L.nnz)
        return factor

    monkeypatch.setattr(averaging, "factor_symmetric", counted)
    edges, weights, free, force = problem("random", spread)
    _solve_laplacian(edges, weights, len(free), free, force)
    assert max(sizes) < 2 * len(
        free
    )  # of a tree; the graph's own factor has hundreds of entries per shape
    monkeypatch.setattr(averaging, "MAX_CG_STEPS", 1)
    _solve_laplacian(edges, weights, len(free), free, force)
    assert max(sizes) > 50 * len(free)
