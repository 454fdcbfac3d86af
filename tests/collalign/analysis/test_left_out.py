"""Whether shapes that do not count differ from those that do."""

import numpy as np
import pytest

from collalign.analysis.left_out import HEADING, compare_left_out

AGES = np.arange(20.0)
SIZES = np.full(20, 7.0)


def test_a_narrower_range_is_said_with_both_ranges():
    counted = (AGES > 2) & (AGES < 15)
    rows, (note,) = compare_left_out(counted, np.exp(AGES / 9), {}, {})
    assert note.code == "left-out-differ"
    assert note.values["column"] == "centroid size"
    assert note.values["range_counted"] == pytest.approx((np.exp(3 / 9), np.exp(14 / 9)))
    assert note.values["range"] == pytest.approx((1.0, np.exp(19 / 9)))
    (row,) = rows
    assert len(row) == len(HEADING)
    assert row[2:4] == [12, 8]


def test_who_is_left_out_at_random_is_no_bias():
    said = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        counted = rng.random(20) > 0.15
        _, notes = compare_left_out(
            counted, SIZES, {"age": rng.permutation(AGES)}, {"sex": rng.choice([*"fm"], 20)}
        )
        said += bool(notes)
    assert said < 25


def test_groups_of_which_more_are_left_out_are_named():
    stages = np.where(AGES < 6, "young", "adult")
    rows, notes = compare_left_out(
        AGES >= 5, SIZES, {}, {"stage": stages, "name": AGES.astype(str)}
    )
    assert [note.values for note in notes] == [
        {"column": "stage", "groups": ("young",), "counted": (1,), "totals": (6,)}
    ]
    assert [row[:4] for row in rows[1:]] == [["stage", "adult", 14, 0], ["stage", "young", 1, 5]]
    few = np.where(AGES < 1, "rare", "common")
    _, (gone,) = compare_left_out(AGES >= 1, SIZES, {}, {"form": few})
    assert gone.values["groups"] == ("rare",)
    assert compare_left_out(np.ones(20, dtype=bool), SIZES, {}, {"form": few}) == ([], [])
