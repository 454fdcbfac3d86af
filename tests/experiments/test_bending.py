"""What the best poses could come to: nothing where the truth is consistent, something where it is not."""

from pathlib import Path

import numpy as np
import pytest

from data_tools.rotations import random_rotation
from experiments.collections.bending import best_possible, row_of
from experiments.collections.posed import PosedCollection


def truth(num):
    rng = np.random.default_rng(0)
    turns = np.stack([random_rotation(rng) for _ in range(num)])
    relative = turns[:, None] @ np.swapaxes(turns, 1, 2)[None]
    return PosedCollection(folder=Path(), names=tuple("abcdefgh"[:num]), relative=relative)


def test_a_contradictory_truth_cannot():
    posed = truth(6)
    posed.relative[0, 1] = posed.relative[0, 1] @ np.diag([1.0, -1.0, -1.0])
    posed.relative[1, 0] = posed.relative[0, 1].T
    errors = posed.pair_errors_deg(best_possible(posed), posed.names)
    assert errors[0] > 90.0
    assert np.median(errors) < 1e-3


def test_a_row_counts_gross_wrong_and_unnoticed():
    record = {
        "errors": np.array([2.0, 40.0, 180.0, 4.0]),
        "possible": np.array([1.0, 1.0, 50.0, 1.0]),
        "shapes": np.array([0.0, 5.0, 90.0, 60.0]),
        "confidence": np.array([0.99, 0.5, 0.99, 0.2]),
        "processor_s": 7.0,
    }
    row = row_of("some", [record, record | {"errors": np.zeros(4)}])
    assert (row["gross"], row["worst"], row["possible_gross"]) == (25.0, 50.0, 25.0)
    assert (row["wrong"], row["unnoticed"], row["right_in_doubt"]) == (4, 2, 2)
    assert row["median"] == pytest.approx(1.0)
