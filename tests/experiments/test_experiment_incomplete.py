"""Rows of the experiment on cut shapes, and a pair of them with data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from collalign.engine.store.store import Store
from experiments.experiment import Bench
from experiments.pairs import incomplete


def test_a_tool_that_was_not_there_has_no_share() -> None:
    record = {"best": [5.0, 30.0], "top": [5.0, 10.0], "seconds": [1.0, 3.0], "open3d": [180.0, 3.0]}
    row = incomplete.pair_row({"collection": "chair", "cut": 2}, record | {"kiss": [np.nan, np.nan]})
    assert (row["best"], row["top"], row["open3d"], row["kiss"]) == (50.0, 100.0, 50.0, None)
    assert (row["cut"], row["pairs"], row["median"], row["seconds"]) == ("both", 2, 17.5, 2.0)


@pytest.mark.data
def test_a_pair_of_cut_glasses_is_measured(shared_data: Path) -> None:
    bench = Bench(data=shared_data, store=Store.memory(), quick=True, quiet=True)
    (table,) = incomplete.measure(bench).tables
    assert [row["pairs"] for row in table.rows] == [1]
