"""The table of maps between bodies counts flips, right candidates and sure maps."""

from dataclasses import astuple

import numpy as np
import pytest

from collalign.confidence.map_model import NEAR, Evidence, map_probability, map_terms
from experiments.calibration.maps import right_candidates
from experiments.maps.bodies import FOUND_MEAN, SURE, row_of, terms_of

#: Standing and evidence of a map that is stated high, and of one that is stated low.
CLEAR, DIM = ((1.0, 2.0), 0.05), ((0.3, -1.0), 0.5)


def record(error, mirrored, candidates, seen):
    own, commutativity = seen
    evidence = Evidence(curvature=0.1, commutativity=commutativity, roughness=0.1, orientation=0.9)
    return {
        "error": error,
        "mirrored": mirrored,
        "candidates": np.array(candidates),
        "standing": np.array([own] * len(candidates)),
        "evidence": np.array([astuple(evidence)] * len(candidates)),
        "seconds": 2.0,
    }


def test_a_row_counts_flips_right_candidates_and_sure_maps():
    records = [
        record(0.02, 0.7, [0.02, 0.7], CLEAR),
        record(0.7, 0.05, [0.7, FOUND_MEAN / 2], CLEAR),
        record(0.5, float("nan"), [0.5, 0.6], DIM),
    ]
    row = row_of("bodies", records)
    assert row["pairs"] == 3
    assert row["median"] == 0.5
    assert row["flipped"] == pytest.approx(100 / 3), (
        "where no mirrored truth is known nothing is flipped"
    )
    assert row["found"] == pytest.approx(200 / 3)
    assert (row["sure"], row["right"]) == (2, 50.0)
    unsure = row_of("bodies", [record(NEAR / 2, 0.7, [0.02], DIM)])
    assert (unsure["sure"], unsure["right"], unsure["flipped"]) == (0, None, 0.0)


def test_terms_and_right_candidates_are_those_of_the_maps():
    one = record(2 * NEAR, 0.7, [0.02, NEAR / 2, 2 * NEAR], CLEAR)
    terms = terms_of(one)
    evidence = Evidence(curvature=0.1, commutativity=0.05, roughness=0.1, orientation=0.9)
    np.testing.assert_array_equal(terms, [map_terms(1.0, 2.0, evidence)] * 3)
    assert map_probability(terms[0], knows_sides=True) >= SURE
    # The chosen one, the first, counts by its map of all vertices, and not by that of the samples.
    np.testing.assert_array_equal(right_candidates(one), [False, True, False])
