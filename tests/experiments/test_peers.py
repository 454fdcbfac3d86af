"""Comparisons with other tools, jobs of teeth and deformed families: what counts as wrong, and quick runs."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from data_tools.datasets.synthetic import deformed_family, planted_collection, write_collection
from data_tools.datasets.synthetic_shapes import chair, crown
from data_tools.io.shapes import write_mesh
from experiments.collections import deformations, teeth_jobs
from experiments.collections.posed import PosedCollection
from experiments.experiment import Cell
from experiments.peers import capod
from experiments.peers.peer_tools import TOOLS


@pytest.fixture
def crowns(rng):
    members = deformed_family(crown(num_vertices=600), 4, rng, rms=0.01)
    return planted_collection(members, rng, scale_range=(0.5, 2.0))


@pytest.fixture
def posed_crowns(crowns, tmp_path):
    write_collection(tmp_path / "crowns", crowns)
    relative = np.array([[crowns.relative_rotation(a, b) for b in range(4)] for a in range(4)])
    names = tuple(shape.name for shape in crowns.shapes)
    return PosedCollection(folder=tmp_path / "crowns", names=names, relative=relative)


def test_figures_see_gross_and_mirrored_pairs(posed_crowns, crowns):
    right = posed_crowns.figures(crowns.rotations, posed_crowns.names)
    assert right["gross"] == right["mirrored"] == 0
    assert right["within_20"] == right["shapes"] == 4
    assert right["median_deg"] < 1e-4
    turned, mirrored = crowns.rotations.copy(), crowns.rotations.copy()
    turned[0] = turned[0] @ np.diag([1.0, -1.0, -1.0])
    mirrored[0] = -mirrored[0]
    wrong = posed_crowns.figures(turned, posed_crowns.names)
    assert (wrong["gross"], wrong["mirrored"], wrong["within_20"]) == (3, 0, 3)
    wrong = posed_crowns.figures(mirrored, posed_crowns.names)
    assert (wrong["gross"], wrong["mirrored"], wrong["within_20"]) == (0, 3, 3)


def write_canonical_class(folder, shapes):
    """Shapes of one frame in the layout of CAPOD; the second is stored turned, and its pose says so."""
    turn = np.diag([-1.0, -1.0, 1.0])
    rows = []
    for i, shape in enumerate(shapes):
        pose = np.eye(4)
        pose[:3, :3] = turn if i == 1 else np.eye(3)
        write_mesh(
            folder / "meshes" / f"m{i}.ply",
            replace(shape, vertices=shape.vertices @ pose[:3, :3].T),
        )
        rows.append({"name": f"m{i}", "file": f"m{i}.ply", "pose_common_to_file": pose.tolist()})
    (folder / "truth.json").write_text(json.dumps({"shapes": rows}))


def test_the_quick_run_of_capod_counts_each_tool(rng, bench, tmp_path, monkeypatch):
    members = deformed_family(crown(num_vertices=600), 4, rng, rms=0.01)
    write_canonical_class(tmp_path / capod.FOLDER / "gun", members)
    monkeypatch.setattr(capod, "TOOLS", {name: TOOLS[name] for name in ("collalign", "axes")})
    outcome = capod.EXPERIMENT.measure(bench)
    rows = {(row["class"], row["tool"]): row for row in outcome.tables[0].rows}
    ours, axes = rows["gun", "collalign"], rows["gun", "principal axes + ICP + tree"]
    assert ours["pairs"] == axes["pairs"] == 6
    assert ours["gross"] == ours["sure_wrong"] == axes["gross"] == 0
    assert "stated" not in axes
    record = {
        "errors": np.array([5.0, 40.0, 180.0]),
        "processor_s": 1.0,
        "stated": 0.5,
        "sure_wrong": 1,
    }
    row = capod.row_of("gun", "collalign", [record, record])
    assert (row["pairs"], row["sure_wrong"]) == (6, 2)
    assert row["gross"] == pytest.approx(200 / 3)


def test_the_quick_run_of_deformations_is_the_same_twice(bench, monkeypatch):
    monkeypatch.setattr(deformations, "PEERS", ("axes",))
    monkeypatch.setattr(deformations, "chair", partial(chair, resolution=1))
    main, families = deformations.EXPERIMENT.measure(bench).tables
    ours = main.rows[0]
    assert (ours["tool"], ours["same_bytes"]) == ("collalign", "yes")
    assert ours["clean"] == (ours["gross"] == 0)
    assert (families.rows[0]["collalign"] == 0) == (ours["gross"] == 0)


@pytest.mark.data
def test_a_job_of_three_teeth_has_no_gross_pair(shared_data):
    record = teeth_jobs.measure_job(
        Cell(
            data=shared_data,
            settings={"num": 3, "one_side": True, "seed": 0, "jobs": 1, "tool": "collalign"},
        )
    )
    assert record["gross"] == record["mirrored"] == 0
    assert 1 < record["landmarks_deg"] < 10
