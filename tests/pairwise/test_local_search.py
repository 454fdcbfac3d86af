"""Alternating minimisation: every end is a local minimum, and the cost kernel is exact."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from pairwise.local_search import MatchingCosts, energies_of, merge, minimise, procrustes
from pairwise.problem import Problem
from pairwise.rotation_sets import random_rotations
from tests.problems import catalogue, planted

PROBLEMS = [known for known in catalogue() if known.problem.pattern.is_block_diagonal]


def starts_for(problem, num, seed=0):
    return problem.pattern.project(random_rotations(problem.dim, num, np.random.default_rng(seed)))


@pytest.mark.parametrize("known", PROBLEMS, ids=lambda known: known.name)
def test_costs_and_maps_are_those_of_the_problem(known):
    problem = known.problem
    rotations = starts_for(problem, 5)
    costs = MatchingCosts(problem)
    expected = np.swapaxes(problem.assignment_costs(rotations), 1, 2)
    own = problem.weights * (problem.source**2).sum(axis=1)
    np.testing.assert_allclose(costs(rotations) + own[:, None], expected, atol=1e-12)
    maps = costs.assign(rotations)
    for cost, point_map in zip(expected, maps, strict=True):
        assert cost[range(len(cost)), point_map].sum() == pytest.approx(
            cost[linear_sum_assignment(cost)].sum()
        )


@pytest.mark.parametrize("known", PROBLEMS, ids=lambda known: known.name)
def test_every_end_is_a_local_minimum_below_its_start(known):
    problem = known.problem
    rotations = starts_for(problem, 12)
    costs = problem.assignment_costs(rotations)
    worst = max(cost[linear_sum_assignment(cost)].sum() for cost in costs)
    found = minimise(problem, rotations)
    assert len(found) >= 1
    assert (np.diff(found.energies) >= 0).all()
    assert found.energies[-1] <= worst + 1e-9
    again = minimise(problem, found.rotations)
    assert again.energies[0] == pytest.approx(found.energies[0], rel=1e-5, abs=1e-9)
    for rotation, point_map, energy in zip(
        found.rotations, found.maps, found.energies, strict=True
    ):
        assert problem.energy(rotation, point_map) == pytest.approx(energy, abs=1e-9)
        assert problem.energy(problem.procrustes(point_map), point_map) == pytest.approx(
            energy, abs=1e-9
        )


def test_energies_come_from_the_differences_themselves(rng):
    problem = planted(rng, rng.random((9, 3)) + 1e6)
    rotations, maps = random_rotations(3, 3, rng), np.stack([rng.permutation(9) for _ in range(3)])
    np.testing.assert_allclose(procrustes(problem, maps), [problem.procrustes(m) for m in maps])
    found = energies_of(problem, rotations, maps)
    np.testing.assert_allclose(
        found, [problem.energy(r, m) for r, m in zip(rotations, maps, strict=True)]
    )


def test_merging_keeps_equal_maps_of_both_chiralities():
    plane = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-1.0, -1.0, 0.0], [2.0, -1.0, 0.0]])
    problem = Problem.from_user(plane, plane, group="O")
    found = minimise(problem, np.stack([np.eye(3), np.diag([1.0, 1.0, -1.0])]), hold_chirality=True)
    assert len(found) == 2
    assert len(merge([found, found])) == 2
