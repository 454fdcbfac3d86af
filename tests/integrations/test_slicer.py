"""The Slicer module's logic, without Slicer: results, coordinates, command line."""

import json
import sys
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from tests.commands import read_json

EXTENSION = Path(__file__).resolve().parents[2] / "integrations" / "slicer"
MODULE = EXTENSION / "Collalign"


def load(name):
    spec = spec_from_file_location(f"slicer_{name}", MODULE / "CollalignLib" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


results, running = load("results"), load("running")


@pytest.fixture
def out(tmp_path):
    rng = np.random.default_rng(0)
    names = np.array(["a", "b"])
    labels, positions = (
        np.stack([rng.permutation(4), rng.permutation(4)]),
        rng.standard_normal((2, 4, 3)),
    )
    np.savez(tmp_path / "correspondences.npz", names=names, labels=labels, positions=positions)
    turn = [[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    shapes = [
        {"name": n, "transform": turn, "confidence": c} for n, c in (("a", 0.99), ("b", None))
    ]
    (tmp_path / "alignment.json").write_text(
        json.dumps({"shapes": shapes, "notes": [{"code": "doubtful", "text": "Look."}]}),
        encoding="utf-8",
    )
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.ply").touch()
    return tmp_path


def test_transforms_act_in_ras_as_they_do_in_lps(out):
    read = results.read_results(out)
    lps = np.array([1.0, 2.0, 3.0, 1.0])
    expected = results.LPS_TO_RAS @ np.array([-1.0, 3.0, 6.0, 1.0])
    assert np.allclose(read.shapes[0].transform @ (results.LPS_TO_RAS @ lps), expected)
    assert not np.allclose(read.shapes[0].transform @ lps, expected)


def test_shapes_whose_files_declare_ras_are_in_the_scene_as_they_stand(out):
    before = results.read_results(out).shapes
    record = read_json(out / "alignment.json")
    record["shapes"][0]["coordinate_system"] = "RAS"
    (out / "alignment.json").write_text(json.dumps(record), encoding="utf-8")
    after = results.read_results(out).shapes
    assert np.allclose(after[0].transform @ results.LPS_TO_RAS, before[0].transform)
    assert np.allclose(after[1].transform, before[1].transform)


def test_points_are_in_the_order_of_their_labels(out):
    read = results.read_results(out)
    with np.load(out / "correspondences.npz") as archive:
        first = archive["positions"][0, archive["labels"][0] == 2][0]
    assert np.allclose(read.shapes[0].points[2], first * [-1, -1, 1])
    assert [shape.in_doubt for shape in read.shapes] == [False, True]
    assert [shape.percent for shape in read.shapes] == ["99 %", "unknown"]
    assert replace(read.shapes[0], confidence=0.9999).percent == "99 %"
    assert [shape.mesh is None for shape in read.shapes] == [False, True]
    assert read.notes == ("Look.",)


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(ValueError, match="not the output"):
        results.read_results(tmp_path)


def test_the_command_is_one_that_collalign_takes(tmp_path):
    (tmp_path / "in").mkdir()
    words = running.command(
        "python", tmp_path / "in", tmp_path / "out", mirrored="O", keep_sizes=True
    )
    assert words[1:4] == ["-m", "collalign", "align"]
    assert words[-4:] == ["--group", "O", "--scaling", "rigid"]
    with pytest.raises(ValueError, match="among them"):
        running.command("python", tmp_path / "in", tmp_path / "in" / "out")


def test_output_of_the_process_is_reported_and_failure_noticed():
    lines = []
    assert running.run([sys.executable, "-c", "print('one'); raise SystemExit(3)"], lines.append)
    assert not running.run([sys.executable, "-c", "raise SystemExit(2)"], lines.append)
    assert lines == ["one"]
