"""Tuned constants are listed as the code has them, and measured on what is named."""

from importlib import import_module
from math import isfinite
from pathlib import Path

import numpy as np
import pytest

from collalign.confidence import radius_model
from collalign.confidence.candidate_model import WEIGHTS
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.errors import OptionsError
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges
from experiments.calibration import CALIBRATIONS, calibrate, ellipsoids, few_radii
from experiments.calibration.evidence import WeighedPair, fit_logit, share_right
from experiments.calibration.fragments import broken, closed
from experiments.calibration.kinds import Evidence, fit_weights, left_out, mean_purity
from experiments.calibration.scan import Calibration, Finding, scan


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_calibration_names_a_module_and_its_constants(name):
    found = CALIBRATIONS[name]
    import_module(found.module)
    assert found.constants
    assert found.collections


def test_both_values_stand_side_by_side(monkeypatch):
    used = []

    def measure(_, collections, quick):
        used.append(collections)
        return {"A": Finding(value=4.0 if quick else 2.0)}

    entry = Calibration(
        module="somewhere", constants={"A": 1.0}, measure=measure, collections=("all of it",)
    )
    monkeypatch.setitem(CALIBRATIONS, "mine", entry)
    (row,) = calibrate("mine", Path()).rows
    assert (row["code"], row["measured"]) == ("1", "2")
    assert calibrate("mine", Path(), ["one"], quick=True).rows[0]["measured"] == "4"
    assert used == [("all of it",), ("one",)]
    with pytest.raises(OptionsError, match="mine"):
        calibrate("nobody's", Path())


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


def test_the_logit_finds_what_tells_right_poses():
    rng = np.random.default_rng(0)
    pairs = []
    for _ in range(200):
        logs = rng.standard_normal((6, len(WEIGHTS)))
        right = np.arange(6) == np.argmin(logs[:, 0] + 0.2 * rng.standard_normal(6))
        pairs.append(WeighedPair(logs=logs, right=right))
    weights = fit_logit([pairs])
    assert weights[0] > 5.0 * weights[1:].max()
    assert share_right(pairs, weights) > 0.8 > share_right(pairs, np.ones(len(WEIGHTS)))


def test_a_closed_piece_has_no_border_and_winds_outwards():
    rng = np.random.default_rng(0)
    ball = Shape.from_arrays(*sphere_mesh(300), name="ball")
    up = np.array([0.0, 0.0, 1.0])
    piece = closed(broken(broken(ball, up, 0.7, rng), -up, 0.6, rng), rng)
    assert not len(boundary_edges(piece.faces))
    corners = piece.vertices[piece.faces]
    assert np.linalg.det(corners).sum() / 6 > 1


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "collection"),
    [
        ("model", "glasses"),
        ("sides", "teeth"),
        ("evidence", "glasses"),
        ("margins", "chair"),
        ("kinds", "generated"),
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


def evidence_of_kinds(called, rng):
    """Evidence of five shapes each of four kinds, which only that of the first weight tells apart."""
    kinds = np.repeat([f"{called}: {k}" for k in range(4)], 5)
    apart = (kinds[:, None] != kinds).astype(float)
    values = {}
    for name, told in (("MISMATCH", 1.0), ("SHELLS", 0.0)):
        noise = 0.15 * rng.standard_normal(apart.shape)
        values[name] = told * apart + noise + noise.T
    return Evidence(kinds=kinds, values=values)


def test_what_tells_kinds_apart_has_the_weight_and_kinds_left_out_are_told_apart_too():
    rng = np.random.default_rng(0)
    drawn = [evidence_of_kinds(called, rng) for called in "abc"]
    names = ("MISMATCH", "SHELLS")
    fitted = fit_weights(drawn, names)
    assert fitted.weights[0] < -1.0
    assert abs(fitted.weights[1]) < 0.2 * abs(fitted.weights[0])
    assert mean_purity(drawn, left_out(drawn, names)) > 0.9
    nothing = [np.zeros((20, 20))] * 3
    assert mean_purity(drawn, nothing) == 0.25


def test_radii_of_few_templates_are_fitted_to_ranks_and_hold_on_average():
    rng = np.random.default_rng(0)

    def collection(factor, num):
        shown = np.exp(rng.normal(2, 1, (3, num, 4)))
        errors = factor * shown[..., 1] ** 1.5 * np.exp(rng.normal(0, 0.3, (3, num)))
        return list(zip(shown, errors, strict=True))

    seen = [collection(1.0, 100), collection(2.0, 700)]
    found = few_radii.fit_few(seen)
    assert list(found) == list(CALIBRATIONS["few_radii"].constants)
    table = [finding.value for finding in found.values()]
    for finding in found.values():
        assert finding.best > max(0.9, finding.now)
        assert finding.left_out > 0.9
        np.testing.assert_allclose(finding.value[1:], [0.0, 1.5, 0.0, 0.0], atol=0.1)
    inside = np.array([few_radii.covered(one, table) for one in seen])
    np.testing.assert_allclose(inside.mean(axis=0), 0.9, atol=0.01)
    assert (inside[0] > inside[1]).all(), "both count the same, whatever their numbers"


def test_ellipsoids_are_as_large_as_the_worst_collection_needs():
    ratios = np.linspace(0.0, 1.0, 101)
    records = [
        {f"held {k}": factor * np.append(ratios, np.nan) for k in (1, 2, 3)}
        for factor in (0.5, 2.0)
    ]
    found = ellipsoids.fit_ellipsoids(records)
    np.testing.assert_allclose(found.value, 1.8 * np.array(radius_model.ELLIPSOIDS_OF_FEW))
    assert found.best == pytest.approx((1.0 + 91 / 101) / 2)
    assert found.now == pytest.approx((1.0 + 51 / 101) / 2)
    assert found.left_out == pytest.approx((1.0 + 23 / 101) / 2)
