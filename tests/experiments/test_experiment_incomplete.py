"""Rows of the experiment on cut shapes, and a pair of them with data."""

import pytest

from collalign.engine.store.store import Store
from experiments.experiment import Bench
from experiments.pairs import incomplete
from experiments.pairs.incomplete_sets import complete_row, cut_row, scan_pair_rows, scan_row

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
    assert (row["named"], row["wrongly"], row["right"], row["whole"], row["without"]) == (1, 1, 1, 1, 2)
    assert (row["worst"], row["noticed"], row["same"], row["way"]) == (90.0, "1 of 2", "no", "looked for")
    scans = scan_row({"shape_deg": [1.0, 6.0, 40.0], "confidence": [0.99, 0.5, 0.5], "processor_s": 1.0})
    assert (scans["within_5"], scans["within_20"], scans["noticed"], scans["doubtful"]) == (1, 2, "1 of 1", 1)
    pairs = {"overlap": [0.35, 0.4, 0.9], "best": [1.0, 90.0, 2.0], "chance": [0.99, 0.6, 0.99], "seconds": [1.0] * 3}
    rows = scan_pair_rows(pairs)
    assert [(one["overlap"], one["pairs"], one["right"]) for one in rows] == [
        ("30 to 50", 2, 50.0),
        ("70 to 100", 1, 100.0),
    ]
    assert rows[0]["noticed"] == "1 of 1"
    complete = complete_row(settings, {"same": True, "named": [], "auto_s": 2.2, "never_s": 2.0})
    assert (complete["same"], complete["named"], complete["ratio"]) == ("yes", 0, pytest.approx(1.1))


@pytest.mark.data
def test_a_pair_of_cut_glasses_is_measured(shared_data):
    bench = Bench(data=shared_data, store=Store.memory(), quick=True, quiet=True)
    (table,) = incomplete.measure(bench).tables
    assert [row["pairs"] for row in table.rows] == [1]
