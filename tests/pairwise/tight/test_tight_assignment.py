import itertools

import numpy as np
import pytest

from pairwise.tight.assignment_bounds import forced_bounds


def brute_forced(costs):
    """The cheapest assignment, free and forced to use each match, by trying all."""
    n, k = costs.shape
    maps = np.array(list(itertools.permutations(range(n), k)))
    values = costs[maps, np.arange(k)].sum(axis=1)
    forced = np.full((n, k), np.inf)
    for point_map, value in zip(maps, values, strict=True):
        forced[point_map, np.arange(k)] = np.minimum(forced[point_map, np.arange(k)], value)
    return values.min(), forced


def random_costs(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    k = int(rng.integers(1, n + 1))
    costs = rng.standard_normal((n, k)).round(1)  # rounding makes ties
    costs[rng.random((n, k)) < 0.2] = np.inf
    costs[rng.permutation(n)[:k], np.arange(k)] = rng.standard_normal(k)
    return costs


@pytest.mark.parametrize("seed", range(40))
def test_forced_bounds_are_the_brute_force_values(seed):
    costs = random_costs(seed)
    value, forced = brute_forced(costs)
    bound, forced_bound = forced_bounds(costs)
    assert bound <= value
    assert bound == pytest.approx(value, abs=1e-9)
    finite = np.isfinite(forced)
    np.testing.assert_allclose(forced_bound[finite], forced[finite], atol=1e-9)
    assert (forced_bound[finite] <= forced[finite] + 1e-15).all()
    assert not np.isfinite(forced_bound[~np.isfinite(costs)]).any()


def test_brute_force_rejects_a_wrong_bound():
    costs = np.array([[1.0, 5.0], [2.0, 1.0]])
    value, forced = brute_forced(costs)
    assert value == 2.0
    assert forced[1, 0] == 7.0  # not 2, its own cost
