"""The experiment on partial scans: its data, its rows, and its quick run on generated shapes."""

import json

import numpy as np
import pytest

from collalign.engine.store import Store
from data_tools.datasets.synthetic_shapes import blob, crown
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.experiment import Bench
from experiments.peers import scans
from tests.optional import PEERS_EXTRA, optional_module

SCANS = ("left", "middle", "right")


def write_scans(folder):
    """Three parts of one surface, each in its own frame, and their poses."""
    rng = np.random.default_rng(5)
    whole = blob(rng, num_vertices=1600)
    along = whole.vertices[:, 0]
    lines = []
    for name, (low, high) in zip(SCANS, ((0.0, 0.8), (0.1, 0.9), (0.2, 1.0)), strict=True):
        kept = (along >= np.quantile(along, low)) & (along <= np.quantile(along, high))
        turn = random_rotation(rng)
        write_mesh(folder / f"{name}.ply", Shape.from_arrays(whole.vertices[kept] @ turn))
        half = np.trace(turn) + 1.0
        w = 0.5 * np.sqrt(half)
        x, y, z = (
            np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        ) / (4.0 * w)
        lines.append(f"bmesh {name}.ply 0 0 0 {-x} {-y} {-z} {w}")
    (folder / "scans.conf").write_text("\n".join(lines), "utf-8")


@pytest.fixture(scope="module")
def layouts(tmp_path_factory):
    root = tmp_path_factory.mktemp("scans")
    write_scans(root / scans.SCANS_FOLDER)
    folder = root / scans.CAPOD_FOLDER / "horse"
    write_mesh(folder / "meshes" / "m1.ply", crown(np.random.default_rng(2), num_vertices=1500))
    pose = {"name": "m1", "file": "m1.ply", "pose_common_to_file": np.eye(4).tolist()}
    (folder / "truth.json").write_text(json.dumps({"shapes": [pose]}))
    return root


def test_scans_are_apart_by_what_they_share(layouts):
    found = scans.read_scans(scans.BUNNY, layouts, 3)
    assert found.apart[0, 1] == found.apart[1, 2] == 2
    common = [cloud.vertices @ found.relative[0, i].T for i, cloud in enumerate(found.clouds)]
    offsets = [cloud - cloud.mean(axis=0) for cloud in common]
    np.testing.assert_allclose(np.cov(offsets[0].T), np.cov(offsets[1].T), atol=0.2)


def test_views_are_apart_by_their_angle(layouts):
    found = scans.read_scans("horse", layouts, scans.NUM_VIEWS)
    assert found.apart[0, 1] == found.apart[0, 14] == 0
    assert found.apart[0, 4] == 3
    assert found.apart[0, 5] == found.apart[0, 0] == -1
    assert (found.apart[np.triu_indices(scans.NUM_VIEWS, 1)] >= 0).sum() == scans.NUM_VIEWS * len(
        scans.GAPS
    )


def test_pairs_count_within_sixteen_degrees():
    record = {"pair_deg": np.array([3.0, 17.0, 15.0]), "apart": np.array([0, 0, 2]), "pair_s": 1.0}
    row = scans.pair_row("views", "a tool", [record, record])
    assert (row["class_0"], row["class_2"]) == ("2 of 4", "2 of 2")
    assert "class_1" not in row
    assert row["right"] == pytest.approx(200 / 3)
    figures = {
        "errors": [1.0, 40.0, 180.0],
        "processor_s": 2.0,
        "stated": 0.5,
        "sure_wrong": 1,
        "parts": 2,
    }
    row = scans.joined_row("views", "collalign", figures)
    assert (row["median"], row["parts"], row["stated"], row["sure_wrong"]) == (40.0, 2, 50.0, 1)


def test_the_quick_run_measures_views_of_a_generated_object(layouts, monkeypatch):
    optional_module("rustcpd", PEERS_EXTRA)
    monkeypatch.setattr(
        scans, "MATCHERS", {"principal axes + CPD": scans.MATCHERS["principal axes + CPD"]}
    )
    bench = Bench(data=layouts, store=Store.memory(), quick=True, quiet=True)
    pairs, joined = scans.EXPERIMENT.measure(bench).tables
    assert [row["tool"] for row in pairs.rows] == ["collalign", "principal axes + CPD"]
    assert pairs.rows[0]["class_0"].endswith("of 3")
    assert [row["scans"] for row in joined.rows] == ["horse", "horse"]
