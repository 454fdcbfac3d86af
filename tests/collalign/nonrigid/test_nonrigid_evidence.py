"""Evidence for a map, masks and the graph operator, on numbers that are known."""

import numpy as np
import pytest

from collalign.confidence.map_model import FLOOR, LIMB_WEIGHT, STRETCH_WEIGHT, Evidence
from collalign.nonrigid.map_evidence import _commutativity_gap


def evidence(**values):
    fields = dict.fromkeys(("curvature", "commutativity", "roughness"), 0.1)
    return Evidence(**{**fields, "orientation": 1.0, **values})


def test_the_score_adds_logarithms_and_counts_curvature_twice():
    base = evidence().score
    assert base == pytest.approx(4.0 * np.log(0.1))
    assert evidence(curvature=0.2).score - base == pytest.approx(2.0 * np.log(2.0))
    assert evidence(commutativity=0.2).score - base == pytest.approx(np.log(2.0))
    assert evidence(roughness=0.2).score - base == pytest.approx(np.log(2.0))
    assert evidence(orientation=-1.0).score == base  # swapped is as clear as kept
    assert evidence(orientation=0.25).score - base == pytest.approx(0.75)
    assert evidence(curvature=0.0).score - base == pytest.approx(2.0 * np.log(FLOOR / 0.1))
    assert evidence(stretch=4.0).score - base == pytest.approx(STRETCH_WEIGHT * np.log(4.0))
    assert evidence(limbs=0.2).score - base == pytest.approx(LIMB_WEIGHT * np.log(0.2))
    assert evidence(curvature=np.nan, orientation=np.nan).score == pytest.approx(2.0 * np.log(0.1))


def test_a_map_between_different_spectra_commutes_where_its_entries_allow():
    target, source = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    entry = np.zeros((3, 3))
    # Function 2 of the target (value 2) becomes function 1 of the source (value 3).
    entry[1, 2] = 1.0
    assert _commutativity_gap(entry, target, source) == pytest.approx((3.0 - 2.0) / (3.0 + 2.0))
    entry = np.zeros((3, 3))
    entry[2, 1] = 1.0
    assert _commutativity_gap(entry, target, source) == pytest.approx((4.0 - 1.0) / (4.0 + 1.0))
    assert _commutativity_gap(np.eye(3), target, target) == 0.0
    assert _commutativity_gap(np.zeros((3, 3)), target, source) == 1.0
