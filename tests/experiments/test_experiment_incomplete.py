"""The experiment on cut shapes: what is cut off, its rows, and its quick run with data."""

import numpy as np
import pytest

from collalign.engine.store import Store
from data_tools.datasets.synthetic_shapes import crown
from experiments.experiment import Bench
from experiments.pairs import incomplete
from experiments.pairs.incomplete import complete_row, cut_row, without_share

pytestmark = pytest.mark.usefixtures("quick_search")


def test_rows_of_collections_count_what_is_cut_apart_from_what_is_whole():
    settings = {"collection": "teeth", "share": 0.25, "way": "auto", "shapes": 4}
    record = {
        "names": ["a", "b", "c", "d"],
        "cut": ["a", "c"],
        "named": ["c", "d"],
        "shape_deg": [90.0, 1.0, 8.0, 30.0],
        "confidence": [0.6, 0.99, 0.99, 0.99],
        "without_deg": [1.0, 2.0],
        "as_without": False,
        "processor_s": 3.0,
    }
    row = cut_row(settings, record)
    assert (row["named"], row["wrongly"], row["right"], row["whole"], row["without"]) == (
        1,
        1,
        1,
        1,
        2,
    )
    assert (row["worst"], row["noticed"], row["same"], row["way"]) == (
        90.0,
        "1 of 2",
        "no",
        "looked for",
    )
    complete = complete_row(settings, {"same": True, "named": [], "auto_s": 2.2, "never_s": 2.0})
    assert (complete["same"], complete["named"], complete["ratio"]) == (
        "yes",
        0,
        pytest.approx(1.1),
    )


def test_a_quarter_is_cut_off_on_one_side(rng):
    shape = crown(rng)
    cut = without_share(shape, np.array([1.0, 0.0, 0.0]), 0.25)
    limit = np.quantile(shape.vertices[:, 0], 0.75)
    assert cut.vertices[:, 0].max() <= limit
    assert len(cut.vertices) == pytest.approx(0.75 * len(shape.vertices), rel=0.02)
    assert set(np.unique(cut.faces)) == set(range(len(cut.vertices)))
    kept = {tuple(vertex) for vertex in shape.vertices[shape.vertices[:, 0] <= limit]}
    assert {tuple(vertex) for vertex in cut.vertices} <= kept


@pytest.mark.data
def test_a_few_ants_of_which_one_is_cut_are_measured(shared_data):
    bench = Bench(data=shared_data, store=Store.memory(), quick=True, quiet=True)
    table, _ = incomplete.measure(bench).tables
    assert [(row["shapes"], row["cut"]) for row in table.rows] == [(4, 1)]
