"""Exact assignment of many matrices: the cost of SciPy's solver from any potentials, and a proof of each match."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from pairwise.branch_and_bound.exact_assignment import augment, cheapest_matches


def matrices(k, size, kind, num=5):
    """Costs (num, k, size), each of which has a match of finite cost."""
    rng = np.random.default_rng([k, size])
    costs = rng.random((num, k, size))
    if kind == "ties":
        return np.round(3.0 * costs)
    if kind == "masked":
        allowed = rng.random(costs.shape) < 0.4
        for one in allowed:
            one[np.arange(k), rng.permutation(size)[:k]] = True
        costs[~allowed] = np.inf
    return costs


def solved(costs, potentials):
    maps = np.full(costs.shape[:2], -1)
    cheapest_matches(costs, potentials, maps)
    return maps


def cost_of(costs, point_map):
    return costs[np.arange(len(costs)), point_map].sum()


def is_best(costs, point_map, v):
    """Whether potentials prove a match best: reduced costs are least there, and free columns have the largest."""
    reduced = costs - v
    matched = reduced[np.arange(len(costs)), point_map]
    free = np.setdiff1d(np.arange(len(v)), point_map)
    return bool((matched <= reduced.min(axis=1) + 1e-9).all()) and bool(
        (v[free] >= v.max() - 1e-9).all()
    )


@pytest.mark.parametrize("kind", ["plain", "masked", "ties"])
@pytest.mark.parametrize(("k", "size"), [(1, 1), (1, 4), (5, 5), (12, 30), (40, 40)])
def test_matches_are_the_cheapest_whatever_they_start_from(k, size, kind):
    costs, rng = matrices(k, size, kind), np.random.default_rng(0)
    for start in (np.zeros((5, size)), rng.standard_normal((5, size)), np.full((5, size), 3.0)):
        potentials = start.copy()
        maps = solved(costs, potentials)
        for one, point_map, v in zip(costs, maps, potentials, strict=True):
            assert len(set(point_map.tolist())) == k
            best = linear_sum_assignment(one)
            assert cost_of(one, point_map) == pytest.approx(one[best].sum())
            assert is_best(one, point_map, v)


def test_the_proof_of_a_match_rejects_a_worse_one():
    costs, potentials = matrices(6, 6, "plain"), np.zeros((5, 6))
    maps = solved(costs, potentials)
    worse = maps[0][[1, 0, 2, 3, 4, 5]]
    assert cost_of(costs[0], worse) > cost_of(costs[0], maps[0])
    assert not is_best(costs[0], worse, potentials[0])


def test_potentials_of_a_match_find_it_again_unchanged():
    costs, potentials = matrices(30, 30, "plain"), np.zeros((5, 30))
    maps = solved(costs, potentials)
    kept = potentials.copy()
    assert (solved(costs, potentials) == maps).all()
    np.testing.assert_allclose(potentials, kept, atol=1e-12)


def test_every_row_that_is_added_leaves_the_match_the_cheapest():
    costs = matrices(8, 8, "plain")[0]
    v, row_of = np.zeros(8), np.full(8, -1)
    for row in range(8):
        assert augment(costs, v, row_of, row) >= 0.0
        matched = np.flatnonzero(row_of >= 0)
        assert sorted(row_of[matched]) == list(range(row + 1))
        best = linear_sum_assignment(costs[: row + 1])
        assert costs[row_of[matched], matched].sum() == pytest.approx(costs[best].sum())
