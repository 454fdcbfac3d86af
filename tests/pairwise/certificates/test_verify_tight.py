from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise.certificates.certificate import Certificate
from pairwise.certificates.verify import verify_certificate
from pairwise.certificates.verify_tight import _lift
from pairwise.problem.problem import Problem
from pairwise.tight.lift import make_lift
from pairwise.tight.solve import solve_tight
from tests.oracles import brute_force
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
