"""The stored values that statistics are compared with are what base R computes. Skips without Rscript."""

import subprocess

import numpy as np
import pytest

from tests.optional import optional_program
from tests.r_expected import EXPECTED, LANDMARKS, SCRIPT, check_expected, expected_values


def test_the_stored_values_are_those_of_r(tmp_path):
    optional_program("Rscript", install="apt-get install r-base-core")
    again = tmp_path / "again.csv"
    subprocess.run(["Rscript", "--vanilla", SCRIPT, LANDMARKS, again], check=True, timeout=600)
    stored, found = expected_values(), expected_values(again)
    assert stored.keys() == found.keys()
    np.testing.assert_allclose([*found.values()], [*stored.values()], rtol=1e-10)


def test_another_value_is_noticed():
    stored = expected_values(EXPECTED)
    check_expected(stored)
    for name, value in stored.items():
        with pytest.raises(AssertionError, match=name):
            check_expected({name: value * (1 + 1e-7)})
