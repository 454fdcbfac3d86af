"""Kinds that are mixed: what counts as pure, split and alone."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.collections import kinds
from experiments.collections.kinds import num_alone, num_split, purity

TRUE = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1])


@pytest.mark.parametrize(
    ("found", "share", "split", "alone"),
    [
        ([5, 5, 5, 5, 5, 5, 2, 2, 2], 1.0, 0, 0),
        ([0] * 9, 6 / 9, 0, 0),
        ([0, 0, 0, 1, 1, 1, 2, 2, 2], 1.0, 1, 0),
        ([0, 0, 0, 0, 0, 1, 2, 2, 2], 1.0, 0, 1),
        ([0, 0, 0, 0, 0, 2, 2, 2, 2], 8 / 9, 0, 0),
        ([0, 0, 0, 0, 0, 0, 2, 2, -1], 8 / 9, 0, 0),
    ],
)
def test_merged_kinds_are_impure_and_parts_of_one_are_split(found, share, split, alone):
    found = np.array(found)
    assert purity(TRUE, found) == pytest.approx(share)
    assert (num_split(TRUE, found), num_alone(found)) == (split, alone)


@pytest.mark.data
@pytest.mark.usefixtures("quick_search")
def test_a_quick_run_fills_both_tables(shared_data, bench):
    mixed, single = kinds.measure(replace(bench, data=shared_data)).tables
    assert mixed.rows[0]["shapes"] == 10
    assert mixed.rows[0]["purity"] >= 90.0
    assert single.rows[0]["found"] == 1
