"""Broken shapes: which are cut, and that both readings are measured."""

import numpy as np
import pytest

from experiments.collections import parts
from experiments.collections.parts import CUTS, cut_family


@pytest.mark.parametrize("cut", CUTS)
def test_as_much_is_cut_off_as_is_said_of_the_shapes_that_are_meant(cut):
    share, every = CUTS[cut]
    num = [
        len(one.vertices) for one in cut_family("blobs", cut).members(4, np.random.default_rng(1))
    ]
    whole = max(num) if every > 1 else None
    kept = num[::every]
    assert max(kept) - min(kept) <= 0.02 * max(kept)
    if whole is not None:
        assert num[1] == num[3] == whole
        assert np.allclose(kept, (1.0 - share) * whole, rtol=0.05)


@pytest.mark.usefixtures("quick_search")
def test_a_quick_run_measures_both_readings(bench):
    table, single = parts.measure(bench).tables
    assert [row["reading"] for row in table.rows] == [
        "by default",
        "as whole",
    ]
    assert len(single.rows) == 2
