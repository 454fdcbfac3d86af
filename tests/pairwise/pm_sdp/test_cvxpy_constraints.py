"""The equations written for CVXPY hold for rotations, for nothing else, and say what the built-in solver's say."""

import numpy as np
import pytest

from pairwise.pm_sdp.cvxpy_constraints import (
    cross_product_equations,
    independent_equations,
    orthogonality_equations,
)
from pairwise.pm_sdp.lifted_rotation import LiftedRotation
from pairwise.rotation_pattern import RotationPattern
from tests.problems import random_rotation


def equations_of(pattern, *, cross_products):
    """The equations of a pattern, as (quadratic, linear, constants), and the basis of [R] in rho."""
    basis = LiftedRotation.build(pattern).basis[:, 1:]
    lifted = [orthogonality_equations(pattern)]
    if cross_products:
        lifted.append(cross_product_equations(pattern))
    return independent_equations(lifted, basis), basis


def misses(equations, basis, pattern, rotation):
    """By how much a matrix violates the equations."""
    quadratic, linear, constants = equations
    rho = np.linalg.lstsq(basis, pattern.pack(rotation), rcond=None)[0]
    return quadratic @ np.outer(rho, rho).ravel() + linear @ rho - constants


@pytest.mark.parametrize("cross_products", [False, True])
@pytest.mark.parametrize(
    ("dim", "pattern", "group"),
    [
        (2, None, "SO"),
        (2, None, "O"),
        (3, None, "SO"),
        (4, 1, "O"),
        (5, [3, 2], "SO"),
        (5, [2, 3], "SO"),
    ],
)
def test_equations_hold_for_rotations_and_span_those_of_the_built_in_solver(
    dim, pattern, group, cross_products, rng
):
    pattern = RotationPattern.from_user(pattern, dim, group)
    equations, basis = equations_of(pattern, cross_products=cross_products)
    for _ in range(5):
        rotation = pattern.project(rng.standard_normal((dim, dim)) * pattern.mask)
        if pattern.is_block_diagonal:
            assert np.abs(misses(equations, basis, pattern, rotation)).max() < 1e-12
            assert np.abs(misses(equations, basis, pattern, 1.1 * rotation)).max() > 1e-2
    lifted = LiftedRotation.build(pattern, cross_products=cross_products)
    size = lifted.num_variables
    quadratic, linear, constants = equations
    forms = np.zeros((len(constants), size + 1, size + 1))
    forms[:, 1:, 1:] = quadratic.reshape(-1, size, size)
    forms[:, 0, 1:] = forms[:, 1:, 0] = 0.5 * linear
    forms[:, 0, 0] = -constants
    both = np.concatenate([forms, lifted.equations]).reshape(-1, (size + 1) ** 2)
    assert np.linalg.matrix_rank(both) == len(constants) == len(lifted.equations)


def test_a_reflection_is_no_cross_product(rng):
    pattern = RotationPattern.from_user(None, 3, "SO")
    equations, basis = equations_of(pattern, cross_products=True)
    assert np.abs(misses(equations, basis, pattern, -random_rotation(rng, 3))).max() > 0.1
