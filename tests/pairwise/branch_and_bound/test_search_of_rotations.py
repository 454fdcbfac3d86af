"""The search bounds cells that cover all rotations, and settles none that may hold a better pose."""

import itertools

import numpy as np
import pytest

from data_tools.rotations import rotation_angles
from pairwise.branch_and_bound.bounds import radii_of
from pairwise.branch_and_bound.search import RotationSearch
from pairwise.problem import Problem
from pairwise.rotation_sets import quaternions_to_rotations, random_rotations
from tests.rigid_problems import planted_cube


def started(tol=1e-3):
    search = RotationSearch(Problem.from_user(*planted_cube(8, 0.3, 1)), reflected=False, tol=tol)
    search.descend(np.eye(3)[None])
    return search


def test_the_balls_that_are_bounded_cover_all_rotations_and_open_cells_go_on_to(rng):
    search, balls = started(), []
    evaluate = search._evaluate

    def noted(rotations, reach, *others):
        balls.append((rotations, radii_of(reach)))
        return evaluate(rotations, reach, *others)

    search._evaluate = noted
    corners = np.array([(1.0, *signs) for signs in itertools.product([-1.0, 1.0], repeat=3)]) / 2.0
    rotations = np.concatenate([quaternions_to_rotations(corners), random_rotations(3, 300, rng)])
    for _ in range(3):
        search._split(5, -1e9)
        centres, radii = search._open.cells.balls()
        assert (rotation_angles(rotations[:, None], centres) <= radii).any(axis=1).all()
    centres, radii = balls[0]  # of all cells
    assert (rotation_angles(rotations[:, None], centres) <= radii).any(axis=1).all()


def test_a_bound_is_compared_as_it_is_and_to_the_tolerance():
    search = started()
    energy = search.energy
    assert search.threshold(energy) == pytest.approx((1.0 - 1e-3) * energy, rel=1e-7)
    assert search.threshold(0.5 * energy) == pytest.approx(
        0.5 * energy, rel=1e-7
    )  # the other chirality's pose
    assert not search.is_done(energy)
    search._open.bounds[:] = (1.0 - 2e-3) * energy
    assert not search.is_done(energy)
    search._open.bounds[:] = (1.0 - 5e-4) * energy
    assert search.is_done(energy)
    search._open.bounds[0] = -1.0
    assert search.bound == 0.0  # no match has a negative cost
    assert not search.is_done(energy)


def test_settled_and_collected_cells_keep_their_bounds():
    search = started()
    energy = search.energy
    bounds = energy * np.array([0.95, 2.0, 3.0, 0.9995])
    search._open.bounds[:] = bounds
    search._settle(energy)
    np.testing.assert_array_equal(search._open.bounds, bounds[:1])
    assert search.bound == bounds[0]
    search._open.bounds[:] = 5.0 * energy
    assert search.bound == bounds[3]
