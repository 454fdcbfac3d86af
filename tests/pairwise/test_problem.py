"""The problem's energy, costs and Procrustes step agree with each other, and impossible problems are refused."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import InputError, OptionsError
from pairwise import match, solve_relaxation
from pairwise.problem import Problem
from pairwise.rotation_pattern import RotationPattern


def some_problem(rng, **options):
    return Problem.from_user(rng.random((7, 3)), rng.random((5, 3)), **options)


def test_costs_and_energy_agree(rng):
    problem = some_problem(
        rng, weights=rng.random(5), invariants=(rng.random((7, 2)), rng.random((5, 2)))
    )
    point_map = rng.permutation(7)[:5]
    rotation = problem.pattern.project(rng.standard_normal((3, 3)))
    costs = problem.assignment_costs(rotation)
    assert problem.energy(rotation, point_map) == pytest.approx(
        costs[point_map, np.arange(5)].sum()
    )
    assert not np.isclose(
        problem.energy(rotation, np.roll(point_map, 1)), problem.energy(rotation, point_map)
    )


def test_rounding_errors_are_squares_of_coordinates_and_no_side_counts(rng):
    problem = some_problem(rng, weights=rng.random(5))
    for factor in (-1.0, 10.0):
        other = replace(problem, target=factor * problem.target, source=factor * problem.source)
        assert other.rounding_energy == pytest.approx(factor**2 * problem.rounding_energy)


def test_projection_keeps_pattern_and_determinants(rng):
    matrices = rng.standard_normal((50, 7, 7))
    pattern = RotationPattern.from_user((3, 4), 7, "SO")
    rotations = pattern.project(matrices)
    assert np.allclose(rotations @ rotations.transpose(0, 2, 1), np.eye(7))
    assert np.allclose(np.linalg.det(rotations[:, :3, :3]), 1)
    assert {-1, 1} == set(np.sign(np.linalg.det(rotations[:, 3:, 3:])))
    assert not rotations[:, :3, 3:].any()
    diagonal = RotationPattern.from_user(0, 3, "SO").project(matrices[:, :3, :3])
    assert np.allclose(np.prod(np.diagonal(diagonal, axis1=1, axis2=2), axis=1), 1)
    assert np.allclose(np.abs(diagonal), np.eye(3))


def test_special_projection_of_diagonals_is_nearest():
    pattern = RotationPattern.from_user(0, 3, "SO")
    given = np.diag([3.0, -0.1, 2.0])
    assert np.allclose(pattern.project(given), np.eye(3))


@pytest.mark.parametrize(("pattern", "dim"), [(None, 3), ((3, 2), 5), (0, 4)])
def test_projection_mirrors_on_request_whatever_the_group(rng, pattern, dim):
    matrices = rng.standard_normal((20, dim, dim))
    wanted = rng.random(20) < 0.5
    special = RotationPattern.from_user(pattern, dim, "SO")
    for group in ("SO", "O"):
        found = RotationPattern.from_user(pattern, dim, group).project(matrices, wanted)
        block = special.rotation_block
        np.testing.assert_array_equal(np.linalg.det(found[:, :block, :block]) < 0, wanted)
        np.testing.assert_allclose(found[~wanted], special.project(matrices[~wanted]), atol=1e-12)


def test_pack_is_column_major_and_unpack_its_inverse(rng):
    pattern = RotationPattern.from_user(1, 4, "O")
    matrix = np.where(pattern.mask, rng.random((4, 4)), 0)
    assert pattern.num_entries == 10
    assert np.array_equal(pattern.unpack(pattern.pack(matrix)), matrix)
    full = RotationPattern.from_user(None, 3, "O")
    assert np.array_equal(
        full.pack(np.arange(9.0).reshape(3, 3)), np.arange(9.0).reshape(3, 3).ravel(order="F")
    )


@pytest.mark.parametrize(
    ("pattern", "error"),
    [
        (-1, OptionsError),
        ((2, 2), OptionsError),
        ((0, 3), OptionsError),
        ((1, 2), OptionsError),
        (RotationPattern(np.eye(3, dtype=bool), ((0, 1),)), OptionsError),
        (np.zeros((3, 3)), InputError),
        ([[1, 1, 1], [0, 0, 0], [1, 1, 1]], InputError),
        (np.ones((2, 2)), InputError),
    ],
)
def test_impossible_patterns_are_refused(pattern, error):
    with pytest.raises(error, match="rotation_pattern"):
        RotationPattern.from_user(pattern, 3, "SO")


def test_impossible_problems_are_refused(rng):
    q, p = rng.random((4, 3)), rng.random((3, 3))
    with pytest.raises(InputError, match="k <= n"):
        Problem.from_user(p, q)
    with pytest.raises(InputError, match="shape"):
        Problem.from_user(q, p[:, :2])
    with pytest.raises(InputError, match="two or more"):
        Problem.from_user(q[:, :1], p[:, :1])
    with pytest.raises(OptionsError, match="group"):
        Problem.from_user(q, p, group="U")
    with pytest.raises(InputError, match="target"):
        Problem.from_user(q * np.nan, p)
    nothing = np.ones((4, 3), bool)
    nothing[:, 1] = False
    with pytest.raises(InputError, match="source point 1 has none"):
        Problem.from_user(q, p, allowed=nothing)
    crowded = np.zeros((4, 3), bool)
    crowded[:2] = True
    with pytest.raises(InputError, match="no injective map"):
        Problem.from_user(q, p, allowed=crowded)
    with pytest.raises(InputError, match="invariants of the source"):
        Problem.from_user(q, p, invariants=(np.ones((4, 2)), np.ones((3, 1))))
    with pytest.raises(InputError, match="their squares overflow"):
        Problem.from_user(q, p, invariants=(np.full((4, 1), 1e200), np.ones((3, 1))))


def test_points_as_columns_are_refused_with_the_way_out(rng):
    columns = rng.standard_normal((3, 60))
    with pytest.raises(InputError, match=r"target\.T"):
        Problem.from_user(columns, columns)
    assert Problem.from_user(columns, columns, rotation_pattern=(60,)).dim == 60
    assert Problem.from_user(columns.T, columns.T).dim == 3
    assert Problem.from_user(columns[:, :3], columns[:, :3]).num_source == 3


def test_forbidden_matches_cost_infinitely_much(rng):
    allowed = rng.random((7, 5)) < 0.6
    allowed[np.arange(5), np.arange(5)] = True
    costs = some_problem(rng, allowed=allowed).assignment_costs(np.eye(3))
    np.testing.assert_array_equal(np.isinf(costs), ~allowed)


def test_coordinates_whose_powers_overflow_are_refused_and_others_answered(rng):
    target, source = rng.random((5, 3)), rng.random((5, 3))
    energy, bound = match(target, source).energy, solve_relaxation(target, source).lower_bound
    for unit in (1e100, 1e200, 1e-100, 1e-300):
        for solve in (match, solve_relaxation):
            with pytest.raises(InputError, match="too large or too small"):
                solve(unit * target, unit * source)
    for unit in (1e69, 1e-69):
        assert match(unit * target, unit * source).energy / unit**2 == pytest.approx(
            energy, rel=1e-6
        )
        assert solve_relaxation(
            unit * target, unit * source
        ).lower_bound / unit**2 == pytest.approx(bound, rel=1e-3)
