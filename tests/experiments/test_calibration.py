"""Tuned constants are listed as the code has them, and measured on what is named."""

from importlib import import_module
from math import isfinite
from pathlib import Path

import numpy as np
import pytest

from experiments.calibration import CALIBRATIONS, calibrate, few_radii
from experiments.calibration.kinds import NUM_RIVALS, comparisons, fit_splits, joined
from experiments.calibration.scan import scan

FOLLOWED = {"few_radii": few_radii.RADII, "ellipsoids": few_radii.ELLIPSOIDS}


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
    [
        ("model", "glasses"),
        ("evidence", "glasses"),
        ("margins", "chair"),
        ("kinds", "generated families: chairs and figures"),
        ("kind_parts", "CAPOD: horse"),
        ("maps", "generated bipeds"),
    ],
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


def folder_of_kinds(rng, *, apart):
    """Comparisons of a folder of three kinds of eight shapes each; strangers are less alike by so much."""
    kinds = np.repeat(np.arange(3), 8)
    noise = 0.5 * rng.standard_normal((24, 24))
    odds = 6.0 - apart * (kinds[:, None] != kinds) + noise + noise.T
    return comparisons(odds, kinds)


def test_the_fit_of_splits_tells_kinds_apart_that_it_has_not_seen_and_splits_none():
    rng = np.random.default_rng(0)
    seen = joined([folder_of_kinds(rng, apart=apart) for apart in (4.0, 6.0, 8.0)])
    assert seen.differ.sum() == 3 * 3 * NUM_RIVALS
    fitted = fit_splits(seen)
    assert fitted[1] > 0 > fitted[2]
    assert folder_of_kinds(rng, apart=6.0).share_right(fitted) > 0.95
    assert folder_of_kinds(rng, apart=0.0).share_right(fitted) == 0.5, "there are no kinds"
    assert seen.share_right(-fitted) < 0.1


@pytest.mark.parametrize("name", ["few_radii", "ellipsoids"])
def test_sizes_of_few_templates_follow_errors_and_hold_those_of_every_collection(name):
    rng, followed = np.random.default_rng(0), FOLLOWED[name]

    def collection(factor, num):
        shown = np.exp(rng.normal(2, 1, (3, num, len(followed.least))))
        errors = factor * shown[..., 1] ** 1.5 * np.exp(rng.normal(0, 0.3, (3, num)))
        return list(zip(shown, errors, strict=True))

    seen = [collection(1.0, 100), collection(2.0, 700)]
    found = followed.fit(seen)
    assert list(found) == list(CALIBRATIONS[name].constants)
    table = [finding.value for finding in found.values()]
    expected = np.zeros(len(followed.least))
    expected[1] = 1.5
    for finding in found.values():
        assert finding.best > max(0.9, finding.now)
        assert finding.left_out > 0.9
        np.testing.assert_allclose(finding.value[1:], expected, atol=0.15)
    inside = np.array([followed.covered(one, table) for one in seen])
    np.testing.assert_allclose(inside[1], 0.9, atol=0.01)
    assert (inside[0] > 0.95).all(), "the collection that needs the most decides"
    assert table[0][-1] == 0.0, "one template shows no spread"


def test_a_quick_calibration_of_overlaps_needs_no_data():
    rows = calibrate("overlaps", Path(), ["room"], quick=True).rows
    assert [row["constant"] for row in rows] == [*CALIBRATIONS["overlaps"].constants]
    assert all(isfinite(float(str(row["best"]))) for row in rows[:3])


def test_a_quick_calibration_of_wholes_needs_no_data():
    (row,) = calibrate("wholes", Path(), ["hammers"], quick=True).rows
    assert row["constant"] == "WHOLE_WEIGHTS"
    assert isfinite(float(str(row["best"])))
