"""The table of maps between bodies counts flips, right candidates and sure maps."""

import numpy as np
import pytest

from experiments.maps.bodies import FOUND_MEAN, RIGHT_MEAN, SURE, row_of


def record(error, mirrored, candidates, confidence):
    return {
        "error": error,
        "mirrored": mirrored,
        "share": 1.0,
        "candidates": np.array(candidates),
        "confidence": confidence,
        "seconds": 2.0,
    }


def test_a_row_counts_flips_right_candidates_and_sure_maps():
    records = [
        record(0.02, 0.7, [0.02, 0.7], 0.95),
        record(0.7, 0.05, [0.7, FOUND_MEAN / 2], 0.92),
        record(0.5, float("nan"), [0.5, 0.6], 0.2),
    ]
    row = row_of("bodies", records)
    assert row["pairs"] == 3
    assert row["median"] == 0.5
    assert row["flipped"] == pytest.approx(100 / 3), (
        "where no mirrored truth is known nothing is flipped"
    )
    assert row["found"] == pytest.approx(200 / 3)
    assert (row["sure"], row["right"]) == (2, 50.0)
    unsure = row_of("bodies", [record(RIGHT_MEAN / 2, 0.7, [0.02], SURE - 0.01)])
    assert (unsure["sure"], unsure["right"], unsure["flipped"]) == (0, None, 0.0)
