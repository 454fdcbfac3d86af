"""Every step of PM-SDP's verifier against its definition: nothing exceeds its bound, and something reaches it."""

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise.certificates.verify import proven_bound
from pairwise.certificates.verify_pm_sdp import (
    _add_cofactor,
    _eigenvalue_floor,
    _quadratic_upper_bounds,
    _quaternion_slope,
    _rotation_basis,
    _rotation_maximum,
)
from pairwise.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from pairwise.rotation_pattern import RotationPattern
from pairwise.rotation_sets import quaternions_to_rotations
from tests.oracles import brute_force

FULL = np.ones((3, 3), dtype=bool)
NONE = (np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((1, 4, 4)))


def rotation_maximum(F, u, multipliers=NONE, blocks=(0,)):
    basis = _rotation_basis(FULL, ((0, 3),))
    return _rotation_maximum(FULL, basis, list(blocks), np.array(F), np.array(u), multipliers)


def test_the_slope_of_the_quaternion_matrix():
    rng = np.random.default_rng(3)
    t, s = np.nonzero(FULL.T)
    for _ in range(20):
        Y = rng.standard_normal((4, 4))
        Y, x = Y + Y.T, rng.standard_normal(4)
        x /= np.linalg.norm(x)
        R = quaternions_to_rotations(x[None])[0]
        slope = _quaternion_slope(s, t, 0, Y)
        assert 0.25 * np.trace(Y) + slope @ R[s, t] == pytest.approx(x @ Y @ x, abs=1e-12)


def test_multipliers_of_the_hull_are_paid_for():
    rng = np.random.default_rng(4)
    t, s = np.nonzero(FULL.T)
    x = rng.standard_normal((300, 4))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    rotations = quaternions_to_rotations(x)[:, s, t]
    for Y in (np.diag([1.0, 0.0, 0.0, 0.0]), -np.eye(4), np.diag([1.0, -2.0, 0.0, 0.5])):
        u = -0.5 * _quaternion_slope(s, t, 0, Y)
        found = rotation_maximum([np.zeros((9, 9))], [u], (*NONE[:3], Y[None]))
        truth = float((2.0 * rotations @ u).max())
        assert truth <= found
    orthogonal = np.diag([1.0, 0.0, 0.0, 0.0])
    u = -0.5 * _quaternion_slope(s, t, 0, orthogonal)
    assert rotation_maximum(
        [np.zeros((9, 9))], [u], (*NONE[:3], orthogonal[None])
    ) == pytest.approx(0.25, rel=1e-6)


def test_multipliers_of_cofactors_cost_nothing_where_they_explain_all():
    rng = np.random.default_rng(11)
    Z, position = (
        rng.standard_normal((3, 3)),
        {(i, j): 1 + 3 * j + i for i in range(3) for j in range(3)},
    )
    form = np.zeros((10, 10))
    for i, j in np.ndindex(3, 3):
        _add_cofactor(form, position, 0, i, j, 0.5 * Z[i, j])
    found = rotation_maximum([form[1:, 1:]], [form[0, 1:]], (NONE[0], NONE[1], Z, NONE[3]))
    assert found == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("sizes", "special"), [((3, 2), ((0, 3), (3, 5))), ((2, 1), ((0, 2),)), ((2, 2), ())]
)
def test_the_basis_writes_every_rotation_of_the_pattern(sizes, special):
    rng = np.random.default_rng(6)
    dim = sum(sizes)
    labels = np.repeat(np.arange(len(sizes)), sizes)
    mask = labels[:, None] == labels
    basis = _rotation_basis(mask, special)
    t, s = np.nonzero(mask.T)
    for _ in range(5):
        R = RotationPattern(mask, special).project(
            np.where(mask, rng.standard_normal((dim, dim)), 0.0)
        )
        entries = R[s, t] - basis[:, 0]
        rho = np.linalg.lstsq(basis[:, 1:], entries, rcond=None)[0]
        np.testing.assert_allclose(basis[:, 1:] @ rho, entries, atol=1e-12)


def test_eigenvalues_that_a_library_calls_too_large_are_not_believed(monkeypatch):
    monkeypatch.setattr(np.linalg, "eigvalsh", lambda matrix: np.array([1.5]))
    assert _eigenvalue_floor(np.diag([1.0, 2.0, 3.0])) <= 1.0


def test_quadratic_forms_are_bounded_for_vectors_known_in_part():
    rng = np.random.default_rng(8)
    for condition in (1.0, 1e6, 1e12):
        Q = np.linalg.qr(rng.standard_normal((4, 4)))[0]
        F = Q @ np.diag(np.geomspace(1.0 / condition, 1.0, 4)) @ Q.T
        F = 0.5 * (F + F.T)
        w = rng.standard_normal((50, 4))
        error = 0.1 * np.abs(w)
        upper = _quadratic_upper_bounds(F, w, error, _eigenvalue_floor(F))
        exact = np.einsum("ia,ab,ib->i", w, np.linalg.inv(F), w)
        assert (upper >= exact * (1 - 1e-3)).all()
        if condition == 1.0:
            moved = w + error * rng.choice([-1.0, 1.0], w.shape)
            assert (upper >= np.einsum("ia,ab,ib->i", moved, np.linalg.inv(F), moved)).all()


@pytest.fixture(scope="module")
def solved():
    rng = np.random.default_rng(9)
    problem = Problem.from_user(rng.random((5, 3)), rng.random((5, 3)))
    return problem, dict(solve_pm_sdp(problem).certificate.arrays)


def test_matrices_must_be_symmetric_and_betas_not_positive(solved):
    problem, arrays = solved
    upper = {
        "F": np.triu(np.ones((9, 9)), 1),
        "column_multipliers": np.triu(np.ones((3, 3)), 1),
        "row_multipliers": np.triu(np.ones((3, 3)), 1),
        "quaternion_multipliers": np.triu(np.ones((4, 4)), 1),
    }
    for name, change in upper.items():
        with pytest.raises(InputError, match="must be symmetric"):
            proven_bound(problem, "pm-sdp", {**arrays, name: arrays[name] + 1e-9 * change})
    with pytest.raises(InputError, match="must not be positive"):
        proven_bound(problem, "pm-sdp", {**arrays, "beta": arrays["beta"] + 1.0})
    with pytest.raises(InputError, match="not positive definite"):
        proven_bound(problem, "pm-sdp", {**arrays, "F": -arrays["F"]})


def test_huge_potentials_do_not_round_the_bound_upwards(solved):
    problem, arrays = solved
    optimum = brute_force(problem).energy
    rng = np.random.default_rng(10)
    for exponent in range(8, 18):
        for _ in range(5):
            beta = arrays["beta"] - 10.0**exponent * (1.0 + rng.random(5))
            assert proven_bound(problem, "pm-sdp", {**arrays, "beta": beta}) <= optimum
            beta = arrays["beta"] - 10.0**exponent * rng.random()
            assert proven_bound(problem, "pm-sdp", {**arrays, "beta": beta}) <= optimum
