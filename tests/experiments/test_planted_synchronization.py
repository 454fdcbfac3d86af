"""The comparison of synchronizations from end to end."""

from experiments.peers import synchronization


def test_the_quick_run_names_where_another_is_ahead(bench):
    found = synchronization.EXPERIMENT.measure(bench)
    rows = found.tables[0].rows
    assert {row["graph"] for row in rows} == set(synchronization.QUICK)
    ours = {row["graph"]: row["right"] for row in rows if row["tool"] == "collalign"}
    ahead = any(row["right"] > ours[row["graph"]] for row in rows)
    assert ("nowhere in this table" in found.text) == (not ahead)
