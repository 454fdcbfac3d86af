"""Certificates: saved and loaded, accepted when right, refused when changed, damaged or for another problem."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise import Certificate, Problem, solve_relaxation, verify_certificate
from pairwise.pm_sdp.certify import _close_constraints
from pairwise.pm_sdp.lifted_rotation import LiftedRotation
from pairwise.relaxations import solve_pm_sdp
from pairwise.rotation_pattern import RotationPattern
from tests.oracles import brute_force
from tests.problems import planted


@pytest.fixture(scope="module")
def solved():
    rng = np.random.default_rng(5)
    problem = planted(
        rng,
        rng.random((6, 4)),
        num_source=5,
        noise=0.2,
        group="SO",
        rotation_pattern=[3, 1],
        weights=[1.0, 0.5, 2.0, 1.0, 0.1],
        invariants=(rng.random((6, 2)), rng.random((5, 2))),
    )
    return problem, solve_pm_sdp(problem)


def test_round_trip(tmp_path, solved):
    problem, result = solved
    result.certificate.save(tmp_path / "pair.npz")
    loaded = Certificate.load(tmp_path / "pair.npz")
    assert loaded.kind == "pm-sdp"
    assert loaded.problem_hash == result.certificate.problem_hash
    assert verify_certificate(problem.target, problem.source, loaded) == result.lower_bound
    assert result.lower_bound <= brute_force(problem).energy


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 cut off"])
def test_damaged_files_are_refused(tmp_path, content):
    (tmp_path / "bad.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.npz"):
        Certificate.load(tmp_path / "bad.npz")


def test_other_archives_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(InputError, match="not a certificate"):
        Certificate.load(tmp_path / "other.npz")
    with pytest.raises(InputError, match="cannot be read"):
        Certificate.load(tmp_path / "missing.npz")


def test_the_problem_that_a_caller_states_is_compared(rng):
    target, source = rng.random((5, 3)), rng.random((4, 3))
    invariants = (rng.random((5, 2)), rng.random((4, 2)))
    certificate = solve_relaxation(target, source, invariants=invariants).certificate
    mine = Problem.from_user(target, source, invariants=invariants)
    assert verify_certificate(target, source, certificate, problem=mine) == certificate.bound
    masked = np.ones((5, 4), dtype=bool)
    masked[0, 0] = False
    others = {
        "constant_cost": {"invariants": (invariants[0] + 0.1, invariants[1])},
        "special_blocks": {"invariants": invariants, "group": "O"},
        "pattern": {"invariants": invariants, "rotation_pattern": [2, 1]},
        "candidates": {"invariants": invariants, "allowed": masked},
        "weights": {"invariants": invariants, "weights": [1.0, 2.0, 1.0, 1.0]},
    }
    for name, options in others.items():
        stated = Problem.from_user(target, source, **options)
        with pytest.raises(InputError, match=name):
            verify_certificate(target, source, certificate, problem=stated)
    stated = Problem.from_user(target + 1.0, source + 1.0, invariants=invariants)
    with pytest.raises(InputError, match="target, source"):
        verify_certificate(target, source, certificate, problem=stated)


def test_constant_costs_may_be_rounded_in_another_way_at_a_price(rng):
    target, source = rng.random((5, 3)), rng.random((4, 3))
    invariants = (rng.random((5, 2)), rng.random((4, 2)))
    certificate = solve_relaxation(target, source, invariants=invariants).certificate
    mine = Problem.from_user(target, source, invariants=invariants)
    rounded = replace(mine, constant_cost=mine.constant_cost * (1.0 - 5e-13))
    price = certificate.bound - verify_certificate(target, source, certificate, problem=rounded)
    assert price == pytest.approx(5e-13 * mine.constant_cost.max(axis=0).sum(), rel=0.01, abs=0)
    other = replace(mine, constant_cost=mine.constant_cost * (1.0 - 5e-12))
    with pytest.raises(InputError, match="constant_cost"):
        verify_certificate(target, source, certificate, problem=other)


def changed(certificate, name, values):
    return replace(certificate, arrays={**certificate.arrays, name: values})


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("candidates", lambda a: ~a),
        ("weights", lambda a: 1.1 * a),
        ("constant_cost", lambda a: a + 1.0),
        ("pattern", lambda a: np.ones_like(a)),
        ("special_blocks", lambda a: a[:0]),
        ("F", lambda a: 1.01 * a),
        ("F", lambda a: a[:-1]),
        ("F", lambda a: a.astype(np.float32)),
        ("F", lambda a: a * np.nan),
        ("u", lambda a: a + 0.01),
        ("beta", lambda a: a * 2.0 - 1.0),
        ("column_multipliers", lambda a: a - 0.01 * np.eye(len(a))),
        ("row_multipliers", lambda a: a - 0.01 * np.eye(len(a))),
        ("quaternion_multipliers", lambda a: a + np.diag([0.1, 0.0, 0.0, 0.0])),
        ("impossible", lambda a: np.array([[0, 0]])),
    ],
)
def test_changed_arrays_are_refused(solved, name, change):
    problem, result = solved
    certificate = changed(result.certificate, name, change(result.certificate.arrays[name]))
    with pytest.raises(InputError, match="certificate"):
        verify_certificate(problem.target, problem.source, certificate)


def test_missing_arrays_and_wrong_claims_are_refused(solved):
    problem, result = solved
    for name in result.certificate.arrays:
        if name == "impossible":
            continue
        arrays = {key: value for key, value in result.certificate.arrays.items() if key != name}
        with pytest.raises(InputError, match="certificate"):
            verify_certificate(
                problem.target, problem.source, replace(result.certificate, arrays=arrays)
            )
    forged = replace(result.certificate, bound=result.lower_bound + 1e-6)
    with pytest.raises(InputError, match="certificate"):
        verify_certificate(problem.target, problem.source, forged)


def test_what_the_sums_of_a_dual_point_miss_is_spread_over_the_source_points(rng):
    lifted = LiftedRotation.build(RotationPattern.from_user(None, 3, "O"))
    size, y = lifted.num_variables, rng.standard_normal(len(lifted.equations))
    F, g = rng.standard_normal((4, size, size)), rng.standard_normal((5, size))
    closed_F, closed_u = _close_constraints(
        lifted, F + np.swapaxes(F, 1, 2), rng.standard_normal((4, size)), g, y, np.zeros((0, 4, 4))
    )
    expected = np.tensordot(y, lifted.equations, 1)
    np.testing.assert_allclose(
        closed_F.sum(axis=0), (expected + expected.T)[1:, 1:] / 2.0, atol=1e-12
    )
    np.testing.assert_allclose(closed_u.sum(axis=0) + g.sum(axis=0), expected[0, 1:], atol=1e-12)
