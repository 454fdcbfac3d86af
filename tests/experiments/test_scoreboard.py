"""The scoreboard: its sets, what counts as gross, wrong and usable, and the figures of the code before."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from collalign.confidence import reliability_model
from collalign.confidence.reliability_model import RIGHT, STEPS
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.collections import scoreboard
from experiments.collections.posed import PosedCollection
from experiments.collections.scoreboard import Drawn, compare, kinds_of, read_before, row_of
from experiments.datasets import read_truth_folder
from experiments.write import write_experiment


@pytest.fixture
def drawn():
    """Six shapes of two kinds in known random poses."""
    rng = np.random.default_rng(0)
    turns = np.stack([random_rotation(rng) for _ in range(6)])
    relative = turns[:, None] @ np.swapaxes(turns, 1, 2)[None]
    names = ("Sofa1", "Sofa2", "Sofa3", "Chair1", "Chair2", "Chair3")
    posed = PosedCollection(folder=Path(), names=names, relative=relative)
    return Drawn(posed=posed, kinds=kinds_of("kenney_seats10", names)), turns


def answer(drawn, turns, left_out=(), parts=(0,) * 6):
    """The right answer, but for shapes that were left out and the parts that it falls into."""
    kept = [i for i in range(6) if i not in left_out]
    return SimpleNamespace(
        names=tuple(drawn.posed.names[i] for i in kept),
        rotations=np.swapaxes(turns, 1, 2)[kept],
        part_numbers=np.array(parts)[kept],
        confidence=np.full(len(kept), 0.96),
    )


def test_the_right_answer_has_no_errors_and_counts_pairs_of_one_kind(drawn):
    found = compare(answer(*drawn), drawn[0])
    assert len(found["pair_deg"]) == 6
    assert found["pair_deg"].max() < 1e-4
    assert found["shape_deg"].max() < 1e-4
    assert found["stated"].tolist() == [0.96] * 6


def test_a_turned_shape_is_wrong_and_so_are_its_pairs(drawn):
    wrong = answer(*drawn)
    wrong.rotations[4] = np.diag([1.0, -1.0, -1.0]) @ wrong.rotations[4]
    found = compare(wrong, drawn[0])
    assert np.flatnonzero(found["shape_deg"] > 30).tolist() == [4]
    assert (found["pair_deg"] > 30).sum() == 2
    row = row_of("some", [found | {"processor_s": 2.0}] * 2, "abc", None)
    assert (row["gross"], row["wrong_sure"], row["sure"], row["usable"]) == (
        pytest.approx(100 / 3),
        2,
        12,
        100.0,
    )


def test_truth_folders_are_read_with_poses_or_landmarks(tmp_path, rng):
    base = blob(rng, num_vertices=80)
    poses = [random_rotation(rng), random_rotation(rng) @ np.diag([1.0, 1.0, -1.0])]
    rows = []
    for i, pose in enumerate(poses):
        shape = Shape.from_arrays(base.vertices @ pose.T, base.faces)
        write_mesh(tmp_path / "meshes" / f"s{i}.ply", shape)
        full = np.eye(4)
        full[:3, :3] = pose
        rows.append(
            {
                "name": f"n{i}",
                "file": f"meshes/s{i}.ply",
                "pose": full.tolist(),
                "chirality": round(np.linalg.det(pose)),
                "landmarks": shape.vertices[:9].tolist(),
            }
        )
    truth = {"truth": "exact", "shapes": rows}
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    found = read_truth_folder(tmp_path)
    assert found.names == ("n0", "n1")
    assert found.chirality.tolist() == [1, -1]
    np.testing.assert_allclose(found.rotation(0, 1), poses[0] @ poses[1].T, atol=1e-12)
    (tmp_path / "truth.json").write_text(json.dumps(truth | {"truth": "landmarks"}))
    marked = read_truth_folder(tmp_path)
    assert marked.rotations is None
    np.testing.assert_allclose(marked.rotation(0, 1, group="O"), poses[0] @ poses[1].T, atol=1e-5)
    assert rotation_angle_deg(marked.rotation(0, 0)) < 1e-3
    (tmp_path / "truth.json").write_text(json.dumps({"shapes": []}))
    with pytest.raises(InputError, match=r"truth\.json: not the truth of a collection"):
        read_truth_folder(tmp_path)


def test_shapes_are_counted_by_what_they_are_stated_at_and_surer_ones_are_expected_no_worse():
    stated = np.repeat([0.2, 0.92, 0.97, np.nan, 0.999], [6, 8, 8, 3, 10])
    errors_deg = np.repeat([90.0, 1.0, 90.0, 1.0, np.nan], [6, 8, 2, 19, 0])
    rows = {row["from"]: row for row in scoreboard.reliability_rows(stated, errors_deg)}
    counted = {start: (row["shapes"], row["right"]) for start, row in rows.items()}
    assert counted[0.0] == (6, 0)
    assert counted[0.9] == (8, 8)
    assert counted[0.95] == (8, 6)
    assert counted[0.995] == (10, 10)
    assert rows[0.0]["expected"] == 1 / 8
    assert (
        rows[0.9]["expected"] == rows[0.95]["expected"] == (9 + 7 + 1) / 22
    )  # with .99, of which there is none
    expected = [row["expected"] for row in rows.values()]
    assert expected == sorted(expected)


def test_the_product_reads_what_is_expected_as_the_scoreboard_writes_it(tmp_path):
    rows = tuple({"from": step, "expected": step / 3 + 0.6006} for step in STEPS.tolist())
    scoreboard.write_reliability(rows, tmp_path / "reliability.csv")
    steps, right = np.loadtxt(tmp_path / "reliability.csv", delimiter=",", skiprows=1, unpack=True)
    assert steps.tolist() == STEPS.tolist()
    assert right[0] == 0.6, "it is rounded down"
    own = Path(reliability_model.__file__).with_name(reliability_model.FILE).read_bytes()
    current = tuple(
        {"from": step, "expected": share + 1e-9}
        for step, share in zip(STEPS.tolist(), RIGHT.tolist(), strict=True)
    )
    scoreboard.write_reliability(current, tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == own


def test_the_smallest_scoreboard_is_measured_and_written(bench, tmp_path):
    bench = replace(bench, results=tmp_path / "results")
    experiment = scoreboard.EXPERIMENT
    write_experiment(experiment, experiment.measure(bench), bench, tmp_path)
    rows = read_before(tmp_path / "results" / "scoreboard.csv")
    assert [*rows] == ["generated families", "all sets"]
    assert float(rows["all sets"]["gross"]) < 10.0
