"""Search: never worse than many random starts, distinct poses, chirality, blocks in closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.errors import OptionsError
from pairwise.local_search import minimise
from pairwise.problem import Problem
from pairwise.rotation_pattern import RotationPattern
from pairwise.rotation_search import (
    _first,
    apart_rotations,
    leading_problem,
)
from pairwise.rotation_sets import random_rotations
from tests.problems import planted, search


@pytest.mark.parametrize(
    ("seed", "num", "noise"), [(0, 16, 0.15), (1, 20, 0.3), (2, 24, 0.2), (3, 12, 0.5)]
)
@pytest.mark.parametrize("num_source", [None, 10])
def test_search_is_no_worse_than_many_random_starts(seed, num, noise, num_source):
    rng = np.random.default_rng(seed)
    problem = planted(rng, rng.random((num, 3)) - 0.5, noise=noise, num_source=num_source)
    random = minimise(problem, random_rotations(3, 500, rng))
    assert search(problem).energies[0] <= random.energies[0] * (1 + 1e-9)


def test_distinct_keeps_the_first_of_every_cluster():
    turns = Rotation.from_euler(
        "z", [[0.0], [5.0], [20.0], [22.0], [90.0]], degrees=True
    ).as_matrix()
    np.testing.assert_array_equal(apart_rotations(turns, np.deg2rad(15), 8), [0, 2, 4])
    np.testing.assert_array_equal(apart_rotations(turns, np.deg2rad(15), 2), [0, 2])
    np.testing.assert_array_equal(apart_rotations(turns, 0.0, 8), [0, 1, 2, 3, 4])


def test_the_rotation_block_is_the_first_one():
    def block(pattern, dim, group):
        return RotationPattern.from_user(pattern, dim, group).rotation_block

    assert block(None, 3, "SO") == block(None, 3, "O") == 3
    assert block([3, 4], 7, "SO") == block([3, 4], 7, "O") == 3
    assert block(0, 5, "O") == block(2, 5, "SO") == 5
    with pytest.raises(OptionsError, match="first"):
        _ = RotationPattern(np.eye(3, dtype=bool), ((1, 3),)).rotation_block


def test_other_blocks_follow_in_closed_form(rng):
    points = rng.random((18, 7)) - 0.5
    turn = np.zeros((7, 7))
    turn[:3, :3], turn[3:, 3:] = random_rotations(3, 1, rng)[0], random_rotations(4, 1, rng)[0]
    turn[:, 4] *= -1.0
    problem = Problem.from_user(points, points @ turn, rotation_pattern=[3, 4])
    assert leading_problem(problem).dim == 3
    found = search(problem)
    assert found.energies[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found.rotations[0], turn, atol=1e-9)


def test_the_first_of_each_chirality_go_on():
    mirrored = np.arange(20) >= 12
    np.testing.assert_array_equal(_first(8, 20, mirrored), [*range(8), 12, 13])
    np.testing.assert_array_equal(_first(8, 20, None), np.arange(8))
