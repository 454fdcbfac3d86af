"""Evidence for a map, masks and the graph operator, on numbers that are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from collalign.confidence.map_model import FLOOR, LIMB_WEIGHT, STRETCH_WEIGHT, Evidence
from collalign.nonrigid.map_evidence import _commutativity_gap
from collalign.nonrigid.map_starts import candidate_mask
from experiments.maps.paper_chain import agd_gaps


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


def shapes(num, agd_target, agd_source):
    """Two shapes of which masks only need descriptors."""
    waves = np.random.default_rng(2).random((num, 3))
    return (
        SimpleNamespace(samples=np.arange(num), agd=agd_target, waves=waves),
        SimpleNamespace(agd=agd_source, waves=2.0 * waves),
    )


def test_masks_are_widened_by_half_until_a_map_fits():
    # Every source sample resembles the same target samples: only a mask as wide as the shape has an injective map.
    num = 20
    target, source = shapes(num, np.arange(float(num)), np.zeros(num))
    allowed = candidate_mask(agd_gaps(target, source, np.arange(num)), 0.2)
    assert (allowed.sum(axis=0) == num).all()
    # 5 source samples need 5 targets: shares .05, .075, .1125, .169, .253 allow 1, 2, 2, 3, 5 of 20
    few = candidate_mask(agd_gaps(target, source, np.arange(5)), 0.05)
    assert (few.sum(axis=0) == 5).all()
