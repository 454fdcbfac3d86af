import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise.problem.problem import Problem
from pairwise.tight.solve import solve_tight
from pairwise.tight.symmetries import optimal_rotations
from tests.problems import random_rotation

TETRAHEDRON = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])


def cyclic(order, rng, num=2):
    """Points with exactly the rotations by multiples of 360 / order degrees about the z axis."""
    turns = []
    for angle in 2.0 * np.pi * np.arange(order) / order:
        turns.append([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.einsum("tab,nb->tna", np.array(turns), rng.standard_normal((num, 3))).reshape(-1, 3)


def moved(points, rng):
    return points[rng.permutation(len(points))] @ random_rotation(rng, 3).T


def rank_of(moments: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(moments, tol=1e-3 * np.linalg.norm(moments, 2)))


@pytest.mark.parametrize(("order", "rank"), [(1, 1), (2, 2), (3, 3), (4, 3)])
def test_the_rank_and_the_rotations_of_cyclic_symmetry(order, rank, rng):
    points = cyclic(order, rng, num=5 if order == 1 else 2)
    problem = Problem.from_user(moved(points, rng), points)
    result = solve_tight(problem, tol=1e-6)
    assert rank_of(result.moments) == rank
    found = optimal_rotations(problem, result.moments)
    assert len(found) == order
    for rotation in found:
        nearest = np.linalg.norm((points @ rotation.T)[:, None] - problem.target, axis=2).min(axis=1)
        assert nearest.max() < 1e-6


def test_all_rotations_of_a_tetrahedron(rng):
    problem = Problem.from_user(moved(TETRAHEDRON, rng), TETRAHEDRON)
    result = solve_tight(problem, tol=1e-6)
    assert rank_of(result.moments) == 10  # twelve rotations, but only ten dimensions
    assert len(optimal_rotations(problem, result.moments)) == 12


def test_symmetry_in_the_plane(rng):
    square = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])
    problem = Problem.from_user(square, square[[2, 0, 3, 1]])
    result = solve_tight(problem, tol=1e-6)
    assert result.moments.shape == (5, 5)
    assert len(optimal_rotations(problem, result.moments)) == 4


def test_moments_of_another_shape_are_refused(rng):
    with pytest.raises(InputError, match="moments"):
        optimal_rotations(Problem.from_user(TETRAHEDRON, TETRAHEDRON), np.eye(4))
