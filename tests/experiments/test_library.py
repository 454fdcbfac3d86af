"""A library that grows: what counts as posed alike, and a small one."""

import numpy as np
import pytest

from data_tools.rotations import random_rotation
from experiments.collections import library
from experiments.collections.library import share_as_at_once

KINDS = np.array([0, 0, 0, 1, 1])


@pytest.fixture
def once(rng):
    rotations = np.stack([random_rotation(rng) for _ in KINDS])
    return {"names": [*"abcde"], "rotations": rotations, "parts": np.array([0, 0, 0, 1, 1])}


def test_a_library_in_another_frame_and_order_is_the_same(once, rng):
    order = np.array([4, 2, 0, 1, 3])
    frames = np.stack([random_rotation(rng)[None], random_rotation(rng)[None]])[KINDS, 0]
    grown = {
        "names": [once["names"][i] for i in order],
        "rotations": (frames @ once["rotations"])[order],
        "parts": once["parts"][order],
    }
    assert share_as_at_once(once, grown, KINDS) == 1.0


def test_a_pose_that_moved_is_noticed_where_both_ways_pose_the_pair_together(once, rng):
    moved = once["rotations"].copy()
    moved[0] = random_rotation(rng) @ moved[0]
    grown = once | {"rotations": moved}
    assert share_as_at_once(once, grown, KINDS) == 2 / 4
    alone = np.array([9, 0, 0, 1, 1])
    assert share_as_at_once(once, grown | {"parts": alone}, KINDS) == 1.0
    assert np.isnan(share_as_at_once(once, grown | {"parts": np.arange(5)}, KINDS))


@pytest.mark.usefixtures("quick_search")
def test_a_quick_run_finds_the_kinds_both_ways(bench):
    (table,) = library.measure(bench).tables
    assert [row["shapes"] for row in table.rows] == [12, 6, 12, 12]
    assert [row["found"] for row in table.rows] == [2] * 4
    assert [row["purity"] for row in table.rows] == [100.0] * 4
    assert 0.0 <= table.rows[-1]["same"] <= 100.0
