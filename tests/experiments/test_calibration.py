"""Tuned constants are listed as the code has them, and measured on what is named."""

from importlib import import_module
from math import isfinite

import pytest

from experiments.calibration import CALIBRATIONS, calibrate
from experiments.calibration.scan import scan


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_calibration_names_a_module_and_its_constants(name):
    found = CALIBRATIONS[name]
    import_module(found.module)
    assert found.constants
    assert found.collections


def test_a_scan_finds_the_better_value_and_says_what_others_would_have_chosen():
    best = {"one": 2.0, "two": 2.0, "three": 2.0, "odd": 0.5}

    def score(collection, changed):
        value = changed.get("A", 1.0)
        assert isinstance(value, float)
        return -abs(value - best[collection])

    found = scan({"A": 1.0, "B": (3.0, 4.0)}, list(best), score)["A"]
    assert found.value == 2.0
    assert found.now == pytest.approx(-3.5 / 4)
    assert found.best == pytest.approx(-1.5 / 4)
    # Each of the three is served by the other two; the odd one by none.
    assert found.left_out == pytest.approx(-1.5 / 4)
    assert scan({"A": 1.0}, ["one", "odd"], score)["A"].left_out == pytest.approx(-1.5)
    # What makes no difference stays.
    assert scan({"B": (3.0, 4.0)}, ["one"], score)["B"].value == (3.0, 4.0)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "collection"),
    [("model", "glasses"), ("sides", "teeth"), ("evidence", "glasses"), ("margins", "chair")],
)
def test_quick_calibrations_measure_every_constant(shared_data, name, collection):
    rows = calibrate(name, shared_data, [collection], quick=True).rows
    assert [row["constant"] for row in rows] == list(CALIBRATIONS[name].constants)
    for row in rows:
        assert row["measured"]
        assert name == "model" or isfinite(float(str(row["now"])))
    if name == "model":
        assert 0 < float(str(rows[0]["measured"])) < 0.35
        assert 0 <= float(str(rows[1]["measured"])) < 1
