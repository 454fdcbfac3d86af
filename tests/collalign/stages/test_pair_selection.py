from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.stages.choose_pairs import (
    ADDED,
    DEGREE,
    adaptive_pairs,
    all_pairs,
    extend_pairs,
    identity_hashes,
    near_partners,
    select_pairs,
    shape_descriptor,
    without_bridges,
)
from tests.products import samples_at


def samples_of(points, invariants=None):
    centred = points - points.mean(axis=0)
    return samples_at(centred, invariants=invariants, offset=points.mean(axis=0))


def test_pose_size_mirroring_and_order_do_not_matter(rng):
    points = rng.standard_normal((30, 3)) * [3.0, 2.0, 1.0]
    invariants = rng.standard_normal((30, 2))
    order = rng.permutation(30)
    moved = 7.0 * points[order] @ Rotation.random(rng=1).as_matrix().T * [1.0, 1.0, -1.0] + 5.0
    one = shape_descriptor(samples_of(points, invariants))
    other = shape_descriptor(samples_of(moved, 7.0 * invariants[order]))
    np.testing.assert_allclose(one, other, atol=1e-12)
    assert one.shape == (35 + 10,)


def test_invariants_tell_shapes_of_equal_positions_apart(rng):
    samples = samples_of(rng.standard_normal((30, 3)), rng.standard_normal((30, 2)))
    other = replace(samples, invariants=samples.invariants + 1.0)
    assert np.linalg.norm(shape_descriptor(samples) - shape_descriptor(other)) > 0.1


def test_degenerate_shapes_have_finite_descriptors():
    for points in (np.zeros((1, 3)), np.zeros((5, 3)), np.eye(3)[:2]):
        descriptor = shape_descriptor(samples_of(points))
        assert descriptor.shape == (35,)
        assert np.isfinite(descriptor).all()


def hashes(num_shapes, seed=0):
    return identity_hashes(map(str, range(num_shapes)), seed)


def check_pairs(edges, num_shapes):
    """Rows i < j, sorted, distinct; returns the graph."""
    assert edges.dtype == np.int64
    assert edges.shape == (len(edges), 2)
    assert (edges[:, 0] < edges[:, 1]).all()
    rows = [tuple(row) for row in edges.tolist()]
    assert rows == sorted(set(rows))
    graph = nx.Graph(rows)
    graph.add_nodes_from(range(num_shapes))
    assert len(graph) == num_shapes
    return graph


def as_set(edges):
    return {tuple(row) for row in edges.tolist()}


@pytest.mark.parametrize("num_shapes", [0, 1, 2, 7])
def test_all_pairs(num_shapes):
    edges = select_pairs("all", hashes(num_shapes), None)
    check_pairs(edges, num_shapes)
    assert len(edges) == num_shapes * (num_shapes - 1) // 2


@pytest.mark.parametrize("num_shapes", [2, 3, 14, 20, 60, 200])
@pytest.mark.parametrize("kind", ["random", "spread", "two islands", "equal"])
def test_sparse_pairs_have_no_bridge_and_the_wanted_degree(num_shapes, kind, rng):
    descriptors = {
        "random": None,
        "spread": rng.standard_normal((num_shapes, 4)),
        "two islands": rng.standard_normal((num_shapes, 2))
        + 1e3 * (np.arange(num_shapes) % 2)[:, None],
        "equal": np.zeros((num_shapes, 2)),
    }[kind]
    edges = select_pairs("sparse", hashes(num_shapes, seed=3), descriptors)
    graph = check_pairs(edges, num_shapes)
    assert nx.is_connected(graph)
    assert num_shapes == 2 or not nx.has_bridges(graph)
    assert 2 * len(edges) / num_shapes <= DEGREE + 2
    assert num_shapes < DEGREE + 2 or min(degree for _, degree in graph.degree) >= 3


def test_a_growing_collection_adds_only_pairs_with_new_shapes(rng):
    descriptors = rng.standard_normal((110, 3))
    names = [f"shape {i}" for i in rng.permutation(110)]
    for points in (None, descriptors):
        before, after = (
            select_pairs(
                "sparse", identity_hashes(names[:num], 0), None if points is None else points[:num]
            )
            for num in (100, 110)
        )
        added = as_set(after) - as_set(before)
        assert added
        assert all(j >= 100 for _, j in added)
        assert len(added) <= 10 * 16


def test_the_selection_follows_the_shapes_and_not_their_order(rng):
    descriptors = rng.standard_normal((50, 3))
    names = np.array([f"shape {i}" for i in range(50)])
    order = rng.permutation(50)
    one = select_pairs("sparse", identity_hashes(names, 0), descriptors)
    other = select_pairs("sparse", identity_hashes(names[order], 0), descriptors[order])
    named_one = {frozenset(names[list(pair)]) for pair in one.tolist()}
    assert named_one == {frozenset(names[order][list(pair)]) for pair in other.tolist()}
    assert as_set(one) != as_set(select_pairs("sparse", identity_hashes(names, 1), descriptors))


def test_shapes_of_the_same_identity_are_told_apart():
    edges = select_pairs("sparse", identity_hashes(["same content"] * 30, 0), None)
    assert nx.is_connected(check_pairs(edges, 30))
    assert len(edges) < 30 * 29 / 4


def test_repair_joins_parts_by_their_closest_shapes_and_removes_bridges():
    points = np.array([[0.0], [1.0], [2.0], [3.0], [4.0], [50.0]])
    parts = np.array([[0, 1], [1, 2], [0, 2], [3, 4]])
    graph = check_pairs(without_bridges(6, parts, points), 6)
    assert nx.is_connected(graph)
    assert not nx.has_bridges(graph)
    assert graph.has_edge(2, 3)


def test_neighbours_among_equal_descriptors_are_others(rng):
    pairs = near_partners(np.zeros((9, 2)), np.arange(9), np.arange(9), 3)
    assert len(pairs) == 27
    assert (pairs[:, 0] != pairs[:, 1]).all()


def test_adaptive_pairs_go_to_uncertain_shapes(rng):
    descriptors = rng.standard_normal((40, 3))
    edges = select_pairs("adaptive", hashes(40), descriptors)
    confidence = np.full(40, 0.99)
    confidence[[5, 17]] = 0.3, np.nan
    added = adaptive_pairs(edges[:, ::-1], confidence, [], hashes(40), descriptors)
    check_pairs(added, 40)
    assert len(added) == 2 * ADDED
    assert not as_set(added) & as_set(edges)
    assert all(5 in pair or 17 in pair for pair in as_set(added))
    assert (5, 17) not in as_set(added)  # confident partners first
    nearest = np.argsort(np.linalg.norm(descriptors - descriptors[17], axis=1), kind="stable")[
        1:
    ].tolist()
    free = [j for j in nearest if (min(j, 17), max(j, 17)) not in as_set(edges) and j != 5]
    assert all((min(j, 17), max(j, 17)) in as_set(added) for j in free[: ADDED // 2])
    assert len(adaptive_pairs(edges, np.ones(40), [], hashes(40), descriptors)) == 0


def test_adaptive_pairs_join_separate_groups_and_end_when_all_pairs_exist(rng):
    edges, descriptors = np.array([[0, 1], [1, 2], [3, 4]]), rng.standard_normal((5, 2))
    added = adaptive_pairs(
        edges, np.ones(5), [np.arange(3), np.array([3, 4])], hashes(5), descriptors
    )
    assert nx.is_connected(nx.Graph(np.concatenate([edges, added]).tolist()))
    assert len(adaptive_pairs(all_pairs(5), np.zeros(5), [], hashes(5), descriptors)) == 0
    parts = [np.arange(37), np.arange(37, 40)]
    joining = adaptive_pairs(edges, np.ones(40), parts, hashes(40), rng.standard_normal((40, 2)))
    assert set(joining[:, 1].tolist()) == {37, 38, 39}, "the smaller part asks for pairs"
    everything = np.concatenate(
        [edges, adaptive_pairs(edges, np.zeros(5), [], hashes(5), descriptors)]
    )
    assert as_set(everything) == as_set(all_pairs(5))


@pytest.mark.parametrize("strategy", ["all", "sparse"])
@pytest.mark.parametrize("num_old", [1, 3, 50])
def test_extending_joins_new_shapes_to_old_ones(strategy, num_old, rng):
    total = num_old + 4
    descriptors = rng.standard_normal((total, 3))
    edges = extend_pairs(num_old, strategy, hashes(total), descriptors)
    check_pairs(edges, total)
    assert (edges[:, 1] >= num_old).all()
    to_old = edges[edges[:, 0] < num_old]
    assert set(to_old[:, 1].tolist()) == set(range(num_old, total))
    if strategy == "sparse" and num_old == 50:
        assert len(edges) <= 4 * DEGREE
    assert len(extend_pairs(total, strategy, hashes(total), descriptors)) == 0
