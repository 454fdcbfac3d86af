from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from data_tools.errors import InputError
from pairwise.certificates.certificate import Certificate
from pairwise.certificates.verify import proven_bound, verify_certificate
from pairwise.certificates.verify_tight import _assignment_floor, _constant_floor, _forced_floor, _lift, _sum_floor
from pairwise.problem.problem import Problem
from pairwise.tight.lift import make_lift
from pairwise.tight.solve import solve_tight
from tests.oracles import brute_force, injective_maps
from tests.tight_problems import planted_cube


@pytest.fixture(scope="module")
def certified():
    """A pair of 7 and 6 points over O(3), and a certificate with several stages."""
    target, source = planted_cube(7, 0.08, 2, num_source=6)
    result = solve_tight(Problem.from_user(target, source, group="O"))
    assert "proper_1_allowed" in result.certificate.arrays
    return target, source, result


def changed(certificate, name, values):
    return replace(certificate, arrays={**certificate.arrays, name: values})


def test_the_certificate_survives_a_file(certified, tmp_path):
    target, source, result = certified
    result.certificate.save(tmp_path / "proof.npz")
    loaded = Certificate.load(tmp_path / "proof.npz")
    assert verify_certificate(target, source, loaded) == verify_certificate(target, source, result.certificate)
    assert loaded.bound == result.lower_bound


@pytest.mark.parametrize(
    ("dim", "size", "form"), [(3, 10, "tight"), (3, 4, "quaternion"), (2, 3, "tight"), (2, 2, "quaternion")]
)
def test_the_verifier_writes_the_same_lift_on_its_own(dim, size, form):
    entries, identities, trace = _lift(dim, size)
    lift = make_lift(form, dim)
    by_rows = lift.entries.reshape(dim, dim, size, size).transpose(1, 0, 2, 3).reshape(-1, size, size)
    np.testing.assert_allclose(entries, by_rows, atol=1e-15)
    np.testing.assert_allclose(identities, lift.identities, atol=1e-15)
    assert trace == lift.trace


def test_multipliers_that_were_changed_are_refused_or_prove_nothing_false(certified):
    target, source, result = certified
    optimum = brute_force(Problem.from_user(target, source, group="O")).energy
    names = [name for name in result.certificate.arrays if name.endswith("multipliers")]
    assert len(names) >= 9
    rng = np.random.default_rng(3)
    refused = 0
    for name in names:
        values = result.certificate.arrays[name]
        try:
            wrong = changed(result.certificate, name, values + 0.5 * rng.standard_normal(values.shape))
            assert verify_certificate(target, source, wrong) <= optimum
        except InputError:
            refused += 1
    assert refused >= 0.75 * len([name for name in names if result.certificate.arrays[name].size])


def test_a_changed_sum_of_multipliers_is_refused(certified):
    target, source, result = certified
    for name in ("proper_0_target_multipliers", "proper_0_source_multipliers"):
        values = result.certificate.arrays[name].copy()
        values[0, 0, 0] += 0.3
        with pytest.raises(InputError, match="proves"):
            verify_certificate(target, source, changed(result.certificate, name, values))


def test_a_higher_claim_is_refused(certified):
    target, source, result = certified
    with pytest.raises(InputError, match="claims"):
        verify_certificate(target, source, replace(result.certificate, bound=result.lower_bound * 1.01))


def test_other_points_candidates_or_weights_are_refused(certified):
    target, source, result = certified
    with pytest.raises(InputError, match="another problem"):
        verify_certificate(target + 1e-9, source, result.certificate)
    for name in ("candidates", "weights", "constant_cost"):
        values = result.certificate.arrays[name].copy()
        values.flat[0] = not values.flat[0]
        with pytest.raises(InputError, match="another problem"):
            verify_certificate(target, source, changed(result.certificate, name, values))


def test_matches_cannot_be_dropped_without_proof(certified):
    target, source, result = certified
    allowed = result.certificate.arrays["proper_0_allowed"].copy()
    allowed[0, 0] = False
    with pytest.raises(InputError):
        verify_certificate(target, source, changed(result.certificate, "proper_0_allowed", allowed))
    last = max(name for name in result.certificate.arrays if name.startswith("proper_") and name.endswith("allowed"))
    arrays = {name: values for name, values in result.certificate.arrays.items() if not name.startswith("proper_")}
    stage = last.removesuffix("allowed")
    for name, values in result.certificate.arrays.items():
        if name.startswith(stage):
            arrays[name.replace(stage, "proper_0_")] = values
    with pytest.raises(InputError, match="the first stage none"):
        verify_certificate(target, source, replace(result.certificate, arrays=arrays))


def test_both_chiralities_must_be_proven(certified):
    target, source, result = certified
    arrays = {name: values for name, values in result.certificate.arrays.items() if not name.startswith("reflected")}
    with pytest.raises(InputError, match="no proof for the reflected"):
        verify_certificate(target, source, replace(result.certificate, arrays=arrays))


def test_sums_of_multipliers_are_bounded_by_what_they_are_not_by_what_floats_make_of_them():
    _, identities, trace = _lift(3, 4)
    for size in (1e3, 1e9, 1e15):
        lost = 0.2 * np.finfo(np.float64).eps * size
        A = np.stack([size * np.eye(4), -lost * np.eye(4), -size * np.eye(4)])
        assert _constant_floor(A, np.zeros((3, 4, 4)), identities, trace) <= -lost


@pytest.mark.parametrize("form", ["tight", "quaternion"])
def test_huge_multipliers_that_cancel_do_not_round_the_bound_upwards(form):
    rng = np.random.default_rng(6)
    for _ in range(5):
        target, source = rng.random((3, 3)), rng.random((3, 3))
        problem = Problem.from_user(target, source, allowed=np.eye(3, dtype=bool))  # one map: its bound is exact
        arrays = dict(solve_tight(problem, form=form).certificate.arrays)
        last = max(name for name in arrays if name.endswith("_allowed")).removesuffix("allowed")
        optimum = brute_force(problem).energy
        assert proven_bound(problem, form, arrays) == pytest.approx(optimum, rel=1e-6)
        for exponent in range(4, 17):
            changed = dict(arrays)
            size = 10.0**exponent * rng.random()
            for name, sign in (("source_multipliers", 1.0), ("target_multipliers", -1.0)):
                values = arrays[last + name]
                changed[last + name] = values + sign * size * np.eye(values.shape[-1])
            assert proven_bound(problem, form, changed) <= optimum


def test_constant_costs_that_cancel_the_squares_leave_their_rounding():
    rng = np.random.default_rng(7)
    for _ in range(40):
        target, source = rng.random((1, 3)), np.zeros((1, 3))
        problem = Problem.from_user(target, source)
        cost = -float((target**2).sum())
        problem = replace(problem, constant_cost=np.array([[cost]]))
        exact = sum(Fraction(x) ** 2 for x in target[0].tolist()) + Fraction(cost)
        arrays = dict(solve_tight(problem, form="quaternion").certificate.arrays)
        assert Fraction(proven_bound(problem, "quaternion", arrays)) <= exact


def test_negative_costs_leave_the_bound_negative():
    target, source = np.random.default_rng(8).random((2, 4, 3))
    problem = Problem.from_user(target, source)
    problem = replace(problem, constant_cost=np.full((4, 4), -5.0))
    arrays = solve_tight(problem).certificate.arrays
    assert proven_bound(problem, "tight", arrays) <= brute_force(problem).energy < -10.0


def test_bounds_of_assignments_are_exact_to_rounding():
    rng = np.random.default_rng(9)
    for n, k in ((4, 4), (5, 3), (6, 6)):
        costs = rng.standard_normal((n, k))
        costs[rng.random((n, k)) < 0.2] = np.inf
        costs[np.arange(k), np.arange(k)] = 1.0
        rows, cols = linear_sum_assignment(costs)
        best = costs[rows, cols].sum()
        assert best - 1e-12 <= _assignment_floor(costs) <= best
        shifted = costs + 1e12 * rng.random(n)[:, None]
        rows, cols = linear_sum_assignment(shifted)
        exact = sum(Fraction(x) for x in shifted[rows, cols].tolist())
        assert exact - Fraction(1) <= Fraction(_assignment_floor(shifted)) <= exact
    assert _assignment_floor(np.full((2, 2), np.inf)) == np.inf


def test_sums_are_rounded_downwards():
    for terms in ([1e16, 1.0, -1e16], [1e16, 3.0, -1e16], [0.1] * 10):
        assert Fraction(_sum_floor(*terms)) <= sum(Fraction(x) for x in terms)


def test_the_verifier_refuses_partial_matching_and_patterns(certified):
    target, source, result = certified
    problem = Problem.from_user(target, source, group="O")
    with pytest.raises(InputError, match="partial"):
        proven_bound(replace(problem, max_unmatched=1), "tight", result.certificate.arrays)
    blocks = Problem.from_user(target, source, group="O", rotation_pattern=[2, 1])
    with pytest.raises(InputError, match="full rotations"):
        proven_bound(blocks, "tight", result.certificate.arrays)


def test_stages_only_drop_matches_and_each_drops_some():
    rng = np.random.default_rng(10)
    allowed = np.ones((4, 4), dtype=bool)
    allowed[0, 1] = False
    problem = Problem.from_user(rng.random((4, 3)), rng.random((4, 3)), allowed=allowed)
    arrays = dict(solve_tight(problem, form="quaternion", eliminate=False).certificate.arrays)
    again = {name.replace("proper_0_", "proper_1_"): values for name, values in arrays.items()}
    with pytest.raises(InputError, match="must drop matches"):
        proven_bound(problem, "quaternion", {**arrays, **again})
    more = {**arrays, **again, "proper_1_allowed": np.ones((4, 4), dtype=bool)}
    with pytest.raises(InputError, match="other matches than those left"):
        proven_bound(problem, "quaternion", more)
    none = allowed.copy()
    none[:, 2] = False
    with pytest.raises(InputError, match="other matches than those left"):
        proven_bound(problem, "quaternion", {**arrays, **again, "proper_1_allowed": none})


def test_the_cheapest_of_all_dropped_matches_counts():
    rng = np.random.default_rng(11)
    for n, k in ((4, 4), (4, 3), (1, 1)):
        costs = rng.random((n, k))
        dropped = rng.random((n, k)) < 0.5
        dropped[0, 0] = True
        maps = injective_maps(np.ones((n, k), dtype=bool))
        totals = costs[maps, np.arange(k)].sum(axis=1)
        least = totals[dropped[maps, np.arange(k)].any(axis=1)].min()
        assert least + 3.0 - 1e-12 <= _forced_floor(costs, 3.0, dropped) <= least + 3.0
