"""The lifted rotation: its equations hold for every rotation with the pattern, and are as many as there should be."""

import numpy as np
import pytest

from pairwise.pm_sdp.lifted_rotation import LiftedRotation
from pairwise.problem import assignment_support
from pairwise.rotation_pattern import RotationPattern
from tests.problems import random_rotation


@pytest.mark.parametrize("cross", [False, True])
@pytest.mark.parametrize("sizes", [[2], [3], [3, 2], [2, 2], [4]])
def test_equations_hold_for_rotations_and_not_for_others(rng, sizes, cross):
    dim = sum(sizes)
    lifted = LiftedRotation.build(RotationPattern.from_user(sizes, dim, "SO"), cross_products=cross)

    def violation(first):
        matrix = np.zeros((dim, dim))
        start = 0
        for index, size in enumerate(sizes):
            block = first if index == 0 else random_rotation(rng, size, reflected=True)
            matrix[start : start + size, start : start + size] = block
            start += size
        entries = lifted.pattern.pack(matrix)
        rho = np.linalg.lstsq(lifted.basis[:, 1:], entries - lifted.basis[:, 0], rcond=None)[0]
        lifted_rho = np.append(1.0, rho)
        off_basis = np.abs(lifted.basis @ lifted_rho - entries).max()
        equations = np.einsum("mab,a,b->m", lifted.equations, lifted_rho, lifted_rho)
        for _, slopes in lifted.quaternion_blocks:
            moments = np.eye(4) / 4 + np.tensordot(rho, slopes, 1)
            off_basis = max(off_basis, float(np.abs(moments @ moments - moments).max()))
        return max(off_basis, float(np.abs(equations).max(initial=0.0)))

    assert violation(random_rotation(rng, sizes[0])) < 1e-12
    assert violation(1.1 * random_rotation(rng, sizes[0])) > 1e-3
    if sizes[0] < 4:
        assert violation(random_rotation(rng, sizes[0], reflected=True)) > 1e-3


@pytest.mark.parametrize(
    ("sizes", "group", "cross", "both"),
    [
        ([3], "SO", True, False),
        ([3], "SO", False, True),
        ([3], "O", False, True),
        ([2], "SO", False, False),
        ([2], "O", False, True),
        ([3, 2], "SO", True, False),
        ([2, 3], "O", False, True),
        ([4], "O", False, True),
    ],
)
def test_no_equation_is_missing(rng, sizes, group, cross, both):
    """They are all quadratic forms that vanish on the rotations: moments of many leave no others."""
    dim, ends = sum(sizes), np.cumsum(sizes)
    pattern = RotationPattern.from_user(sizes, dim, group)
    lifted, moments = LiftedRotation.build(pattern, cross_products=cross), []
    for at in range(400):
        matrix = np.zeros((dim, dim))
        for number, (size, end) in enumerate(zip(sizes, ends.tolist(), strict=True)):
            side = bool(at >> number & 1) if number or both else False
            block = random_rotation(rng, size, reflected=side)
            matrix[end - size : end, end - size : end] = block
        rho = np.linalg.lstsq(lifted.basis[:, 1:], pattern.pack(matrix), rcond=None)[0]
        moments.append(np.outer([1.0, *rho], [1.0, *rho])[np.triu_indices(len(rho) + 1)])
    num_forms = len(moments[0])
    assert len(lifted.equations) == num_forms - np.linalg.matrix_rank(np.array(moments), tol=1e-8)


def brute_support(allowed):
    from tests.oracles import injective_maps

    maps = injective_maps(allowed)
    used = np.zeros_like(allowed)
    taken = np.zeros((len(maps), len(allowed)), dtype=bool)
    for row, point_map in enumerate(maps):
        used[point_map, np.arange(allowed.shape[1])] = True
        taken[row, point_map] = True
    return used, taken.all(axis=0)


def test_support_agrees_with_brute_force(rng):
    for _ in range(60):
        n = int(rng.integers(1, 6))
        k = int(rng.integers(1, n + 1))
        allowed = rng.random((n, k)) < 0.5
        allowed[rng.permutation(n)[:k], np.arange(k)] = True
        for found, wanted in zip(assignment_support(allowed), brute_support(allowed), strict=True):
            assert np.array_equal(found, wanted)
