"""The comparison of synchronizations from end to end."""

from collalign.engine.store import Store
from experiments.experiment import Bench
from experiments.peers import synchronization


def test_the_quick_run_names_where_another_is_ahead(tmp_path):
    with Store.open(tmp_path / "store.sqlite") as store:
        found = synchronization.EXPERIMENT.measure(
            Bench(data=tmp_path, store=store, quick=True, quiet=True)
        )
    rows = found.tables[0].rows
    assert {row["graph"] for row in rows} == set(synchronization.QUICK)
    ours = {row["graph"]: row["right"] for row in rows if row["tool"] == "collalign"}
    ahead = any(row["right"] > ours[row["graph"]] for row in rows)
    assert ("nowhere in this table" in found.text) == (not ahead)
