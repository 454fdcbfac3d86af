import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from pairwise.branch_and_bound.assignment import bound_assignments
from pairwise.rotation_sets import random_rotations


def random_costs(k, size, kind, rng, num=6):
    """Costs of ``num`` problems in the solver's form, and the full matrices (num, k, size)."""
    points = rng.standard_normal((3, size))
    if kind == "ties":
        points = np.round(points)
    fixed = np.tile((points**2).sum(axis=0)[:, None], (1, k))
    if kind == "masked":
        allowed = rng.random((k, size)) < 0.4
        allowed[np.arange(k), rng.permutation(size)[:k]] = True
        fixed[~allowed.T] = np.inf
    source = -2.0 * (np.round(points.T[:k]) if kind == "ties" else rng.standard_normal((k, 3)))
    turns = (
        np.repeat(np.eye(3)[None], num, axis=0) if kind == "ties" else random_rotations(3, num, rng)
    )
    costs = fixed.T + (source @ np.swapaxes(turns, 1, 2)) @ points
    return fixed, np.ascontiguousarray(source.T), np.swapaxes(turns, 1, 2) @ points, costs


@pytest.mark.parametrize("kind", ["plain", "masked", "ties"])
@pytest.mark.parametrize(("k", "size"), [(1, 1), (1, 4), (5, 5), (20, 20), (12, 30), (60, 60)])
def test_bounds_come_within_the_steps_of_the_optimum(k, size, kind):
    rng = np.random.default_rng([k, size])
    fixed, source, targets, costs = random_costs(k, size, kind, rng)
    num, step = len(targets), 1e-6
    v = rng.standard_normal((num, size)) if kind == "plain" else np.zeros((num, size))
    optima = np.array([c[linear_sum_assignment(c)].sum() for c in costs])
    wanted = optima - np.array([1e-9, 1.0, 0.1] * 2)
    bounds, energies, moments = bound_assignments(
        fixed, source, targets, v, wanted, np.full(num, step)
    )
    rows = np.zeros((size - k, size))
    for c in range(num):
        assert min(optima[c] - 2 * size * step - 1e-9, wanted[c]) <= bounds[c] <= optima[c] + 1e-12
        if np.isfinite(energies[c]):
            assert energies[c] >= optima[c] - 1e-9
            if kind == "plain" and k == size:
                assert fixed.sum() / k + np.trace(moments[c]) == pytest.approx(energies[c])
        full = np.vstack([costs[c], rows]) - v[c]
        assert bounds[c] == pytest.approx(full.min(axis=1).sum() + v[c].sum(), abs=1e-8)
