"""The comparison of synchronizations: its planted pairs, its tools, and its quick run."""

import numpy as np
import pytest

from collalign.engine.store import Store
from experiments.experiment import Bench, Cell
from experiments.peers import synchronization
from experiments.peers.planted_pairs import (
    complete_edges,
    exact_pairs,
    flipped_pairs,
    pose_errors_deg,
)
from experiments.peers.rotation_tools import ROTATION_TOOLS
from tests.optional import PEERS_EXTRA, optional_module


def test_pairs_without_a_right_candidate_are_as_many_as_asked():
    rng = np.random.default_rng(0)
    problem = flipped_pairs(
        rng, complete_edges(40), 40, wrong=0.3, noise_deg=5.0, num_candidates=4, none_right=0.4
    )
    apart = problem.rotations - exact_pairs(problem.truth, problem.edges)[:, None]
    nearest = np.linalg.norm(apart, axis=(2, 3)).min(axis=1)
    assert 0.3 < (nearest > 0.6).mean() < 0.45


@pytest.mark.parametrize("name", ROTATION_TOOLS)
def test_every_tool_finds_the_poses_of_pairs_that_are_mostly_right(name):
    tool = ROTATION_TOOLS[name]
    if tool.package:
        optional_module(tool.package, PEERS_EXTRA)
    problem = flipped_pairs(
        np.random.default_rng(1), complete_edges(12), 12, wrong=0.1, noise_deg=3.0
    )
    rotations, _ = tool.run(problem, float(np.deg2rad(3.0) / np.sqrt(3.0)))
    assert pose_errors_deg(rotations, problem.truth).max() < 10.0


def test_a_wrong_shape_that_is_stated_is_counted(monkeypatch):
    settings = synchronization.GRAPHS["degree 10, all right"]
    problem = synchronization.planted_graph(settings, 3)
    wrong = problem.truth.copy()
    wrong[7] = wrong[7] @ np.diag([1.0, -1.0, -1.0])
    tool = type(ROTATION_TOOLS["collalign"])(run=lambda problem, noise_rad: (wrong, np.ones(100)))
    monkeypatch.setitem(ROTATION_TOOLS, "collalign", tool)
    record = synchronization.measure_graph(
        Cell(data=None, settings={"graph": settings, "tool": "collalign", "seed": 3})
    )
    assert record["right"] == 0.99
    assert record["stated"] == record["stated_wrong"] == 1
    assert record["median_deg"] < 1e-6


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
