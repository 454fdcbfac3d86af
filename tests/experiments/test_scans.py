"""The experiment on partial scans from end to end, on generated shapes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import crown
from data_tools.io.shapes import write_mesh
from experiments.peers import scans
from tests.optional import PEERS_EXTRA, optional_module


@pytest.fixture(scope="module")
def layouts(tmp_path_factory):
    root = tmp_path_factory.mktemp("scans")
    folder = root / scans.CAPOD_FOLDER / "horse"
    write_mesh(folder / "meshes" / "m1.ply", crown(np.random.default_rng(2), num_vertices=1500))
    pose = {"name": "m1", "file": "m1.ply", "pose_common_to_file": np.eye(4).tolist()}
    (folder / "truth.json").write_text(json.dumps({"shapes": [pose]}))
    return root


def test_the_quick_run_measures_views_of_a_generated_object(layouts, bench, monkeypatch):
    optional_module("rustcpd", PEERS_EXTRA)
    monkeypatch.setattr(
        scans, "MATCHERS", {"principal axes + CPD": scans.MATCHERS["principal axes + CPD"]}
    )
    pairs, joined = scans.EXPERIMENT.measure(replace(bench, data=layouts)).tables
    assert [row["tool"] for row in pairs.rows] == ["collalign", "principal axes + CPD"]
    assert pairs.rows[0]["class_0"].endswith("of 3")
    assert [row["scans"] for row in joined.rows] == ["horse", "horse"]
