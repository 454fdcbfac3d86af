"""The lifted equations hold at every orthogonal matrix and fail at others."""

from __future__ import annotations

import numpy as np
import pytest

from pairwise.problem.pattern import RotationPattern
from pairwise.reference.constraints import cross_product_equations, orthogonality_equations, quaternion_moments
from tests.oracles import in_rotation_hull
from tests.problems import random_rotation


def lift(pattern: RotationPattern, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    entries = pattern.pack(matrix)
    return np.outer(entries, entries), entries


@pytest.mark.parametrize("user_pattern", [None, [3, 1], [3, 3], 0, 1])
def test_orthogonal_matrices_satisfy_the_equations(user_pattern: object, rng: np.random.Generator) -> None:
    dim = {"[3, 1]": 4, "[3, 3]": 6}.get(str(user_pattern), 3)
    pattern = RotationPattern.from_user(user_pattern, dim, "O")
    equations = orthogonality_equations(pattern)
    matrix = np.eye(dim) if user_pattern in (0, 1) else pattern.project(rng.standard_normal((dim, dim)))
    assert np.abs(equations.residual(*lift(pattern, matrix))).max() < 1e-12
    bent = np.where(pattern.mask, matrix + 0.01, 0.0)
    assert np.abs(equations.residual(*lift(pattern, bent))).max() > 1e-4


def test_equations_are_independent_and_complete() -> None:
    for user_pattern, dim, rank in ((None, 3, 11), (0, 3, 3), ([2, 1], 3, 6), ([3, 3], 6, 22), (2, 7, 49)):
        equations = orthogonality_equations(RotationPattern.from_user(user_pattern, dim, "O"))
        r = equations.linear.shape[1]
        folded = equations.quadratic.toarray().reshape(-1, r, r)
        folded = (folded + folded.swapaxes(1, 2)).reshape(len(folded), -1)
        assert len(equations.constant) == rank == np.linalg.matrix_rank(folded)


def test_cross_products_tell_rotations_from_reflections(rng: np.random.Generator) -> None:
    pattern = RotationPattern.from_user([3, 2], 5, "SO")
    equations = cross_product_equations(pattern)
    assert len(equations.constant) == 9
    matrix = np.zeros((5, 5))
    matrix[3:, 3:] = random_rotation(rng, 2, reflected=True)
    for reflected in (False, True):
        matrix[:3, :3] = random_rotation(rng, 3, reflected=reflected)
        holds = np.abs(equations.residual(*lift(pattern, matrix))).max() < 1e-12
        assert holds is not reflected


def test_quaternion_moments_decide_the_hull(rng: np.random.Generator) -> None:
    rotation = random_rotation(rng, 3)
    assert np.linalg.eigvalsh(quaternion_moments(rotation)) == pytest.approx([0, 0, 0, 4], abs=1e-12)
    for _ in range(200):
        matrix = rng.uniform(-0.8, 0.8, (3, 3))
        smallest = np.linalg.eigvalsh(quaternion_moments(matrix))[0]
        assert in_rotation_hull(matrix, 0.0) == (smallest >= 0)
