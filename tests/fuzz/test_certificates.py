"""Forged certificates prove nothing false, and the attack finds verifiers that would."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pairwise.certificates import verify_pm_sdp
from pairwise.certificates.verify import VERIFIERS
from tests.fuzz.certificates import forged, honest, judge
from tests.fuzz.damage import fuzzing


def attack(num):
    """Forge certificates and return how many ended in each way that is right; raise where one does not."""
    endings = Counter()

    @fuzzing(num)
    @given(forged(), st.booleans())
    def forge(one, states_problem):
        ending = judge(*one, states_problem)
        assert ending in ("true", "refused")
        endings[ending] += 1

    forge()
    return endings


def test_honest_certificates_are_true():
    assert {certificate.kind for _, certificate in honest()} == VERIFIERS.keys()
    assert {judge(problem, certificate, True) for problem, certificate in honest()} == {"true"}


def test_forged_certificates_prove_nothing_false():
    endings = attack(150)
    assert min(endings["true"], endings["refused"]) > 12


def test_the_attack_finds_a_verifier_that_trusts_eigenvalues(monkeypatch):
    monkeypatch.setattr(verify_pm_sdp, "_eigenvalue_floor", lambda matrix: 1e-3)
    with pytest.raises(AssertionError, match="false: proves"):
        attack(3000)
