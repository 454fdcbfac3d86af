"""Folders of meshes through the whole line, as a user runs it."""

import contextlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions, align_collection, load
from collalign.engine.store import Store
from collalign.output.evidence_file import EVIDENCE_FILE
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.options import EmbeddingOptions, SamplingOptions
from tests.commands import read_json, read_rows, run_command
from tests.finished_runs import angles_deg, chairs
from tests.notes import codes

OPTIONS = AlignOptions(maps="never", sampling=SamplingOptions(num_points=24, num_dense_points=0))
FLAGS = ["--sampling.num-points", "24", "--sampling.num-dense-points", "0", "--jobs", "1"]
FLAGS += ["--maps", "never"]


@pytest.fixture(scope="module")
def planted():
    return chairs(5, scale_range=(0.5, 2.0))


@pytest.fixture(scope="module")
def folder(planted, tmp_path_factory):
    path = tmp_path_factory.mktemp("shapes")
    write_collection(path, planted)
    return path


@pytest.fixture(scope="module")
def finished(folder, tmp_path_factory):
    """The folder of a finished run of the command, and what it printed."""
    out = tmp_path_factory.mktemp("finished") / "out"
    return out, run_command("align", folder, "--out", out, *FLAGS).out


@pytest.fixture
def out(finished, tmp_path):
    """A copy of the finished run, its store included."""
    return Path(shutil.copytree(finished[0], tmp_path / "out"))


@pytest.fixture(scope="module")
def run(finished, tmp_path_factory):
    """Runs that find all shapes and pairs in a store."""
    return RunOptions(
        jobs=1,
        store=Path(shutil.copy(finished[0] / "store.sqlite", tmp_path_factory.mktemp("store"))),
    )


@pytest.fixture(scope="module")
def aligned(folder, run):
    return align_collection(folder, options=OPTIONS, run=run)


def worst_error_deg(rotations, planted):
    return angles_deg(rotations @ np.swapaxes(planted.rotations, 1, 2)).max()


def test_rotations_are_recovered_up_to_one_common_rotation_and_a_wrong_one_is_seen(
    aligned, planted
):
    assert worst_error_deg(aligned.rotations, planted) < 15
    assert not aligned.excluded
    assert (aligned.group, aligned.reflected.any()) == ("SO", False), (
        "bilateral shapes are not mirrored"
    )
    assert np.allclose(aligned.rotations[0], np.eye(3))
    turned = aligned.rotations.copy()
    turned[2] = np.diag([1.0, -1.0, -1.0]) @ turned[2]
    assert worst_error_deg(turned, planted) > 150


def test_maps_are_consistent_and_samples_lie_on_the_shapes(aligned, planted):
    a, b, c = aligned.names[:3]
    assert np.array_equal(aligned.maps[a, b][aligned.maps[b, c]], aligned.maps[a, c])
    assert np.array_equal(aligned.maps[a, a], np.arange(24))
    vertices = planted.shapes[1].vertices[aligned.samples[1]]
    transform = aligned.transforms[1]
    assert np.allclose(vertices @ transform[:3, :3].T + transform[:3, 3], aligned.positions[1])
    with pytest.raises(InputError, match="no shape is called"):
        aligned.maps["nobody", a]


def test_a_reference_and_fixed_poses_are_respected_and_rigid_keeps_sizes(folder, aligned, run):
    name = aligned.names[3]
    rigid = align_collection(
        folder, options=replace(OPTIONS, reference=name, scaling="rigid"), run=run
    )
    assert np.allclose(rigid.rotations[3], np.eye(3))
    assert np.allclose(np.linalg.det(rigid.transforms[:, :3, :3]), 1)
    pose = np.diag([-1.0, -1.0, 1.0])
    fixed = align_collection(folder, options=OPTIONS, run=run, fixed={name: pose})
    assert np.allclose(fixed.rotations[3], pose)
    with pytest.raises(InputError, match="nobody"):
        align_collection(folder, options=OPTIONS, run=run, fixed={"nobody": pose})


def test_command_line_writes_everything_and_reads_like_the_library(folder, aligned, finished):
    out, printed = finished
    record = read_json(out / "alignment.json")
    assert [s["name"] for s in record["shapes"]] == list(aligned.names)
    assert np.array_equal([s["transform"] for s in record["shapes"]], aligned.transforms)
    limits = {"limited_by", "limited_by_text"} if aligned.names[0] in aligned.limited_by else set()
    assert set(record["shapes"][0]) == limits | {
        *("name", "file", "digest", "transform", "reflected", "confidence"),
        *("centroid_size_points", "evidence"),
    }
    with np.load(out / "correspondences.npz") as arrays:
        assert np.array_equal(arrays["labels"], aligned.maps.labels)
        assert np.array_equal(arrays["vertex_indices"], aligned.samples)
    assert len(read_rows(out / "pairs.csv")) == 10
    mesh = read_shape(out / "meshes" / f"{aligned.names[1]}.ply")
    original = read_shape(folder / f"{aligned.names[1]}.ply")
    moved = original.vertices @ aligned.transforms[1, :3, :3].T + aligned.transforms[1, :3, 3]
    assert np.allclose(mesh.vertices, moved, atol=1e-5)
    assert (out / "contact_sheet.png").read_bytes().startswith(b"\x89PNG")
    for name in (
        "alignment.json",
        "correspondences.npz",
        "pairs.csv",
        "meshes",
        "contact_sheet.png",
    ):
        assert str(out / name) in printed
    assert not list(out.glob(".collalign-*"))


def contents(out):
    """Return what a run wrote and what its manifest says of it, by name; all but run.json."""
    files = read_json(out / ".collalign" / "manifest.json")["files"]
    del files["run.json"]
    assert {"report.html", "contact_sheet.png", "evidence.npz"} <= files.keys()
    return {name: (entry, (out / name).read_bytes()) for name, entry in files.items()}


def test_only_run_json_differs_between_two_runs(folder, finished, tmp_path):
    first, second = finished[0], tmp_path / "elsewhere"
    run_command("align", folder, "--out", second, *FLAGS)
    assert contents(first) == contents(second)
    runs = [read_json(out / "run.json") for out in (first, second)]
    assert runs[0]["versions"] == runs[1]["versions"]
    for name in ("date", "command", "times_s"):
        assert runs[0][name] != runs[1][name]
        assert getattr(load(second).run, name) == runs[1][name]
    assert runs[1]["date"] not in (second / "report.html").read_text("utf-8")
    (second / "run.json").unlink()
    assert load(second).run.date == ""
    (second / "run.json").write_text('{"date": 5}')
    with pytest.raises(InputError, match=r"run\.json: damaged"):
        load(second)


def test_one_bad_file_is_left_out_and_named(folder, planted, tmp_path):
    mixed = tmp_path / "mixed"
    write_collection(mixed, planted)
    (mixed / "broken.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\n")
    (mixed / "notes.md").write_text("not a shape")
    out = tmp_path / "out"
    captured = run_command("align", mixed, "--out", out, "--no-report", *FLAGS, ends=3)
    assert "broken.ply" in captured.err
    assert "notes.md" in captured.out
    record = read_json(out / "alignment.json")
    assert [item["file"] for item in record["excluded"]] == ["broken.ply"]
    assert len(record["shapes"]) == 5
    said = run_command("align", mixed, "--out", tmp_path / "strict", "--strict", *FLAGS, ends=2)
    assert said.err.count("broken.ply") == 1
    assert not (tmp_path / "strict" / "alignment.json").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["align", "nowhere", "--out", "out"], "nowhere"),
        (["align", ".", "--out", "out", "--sampling.num-points", "1"], "num_points"),
        (["align", ".", "--out", "out", "--group", "U"], "group"),
        (["align", ".", "--out", "out", "--unknown", "1"], "--unknown"),
        (["align", ".", "--out", "out", "--jobs", "0"], "jobs"),
        (["align", ".", "--out", "."], "name a folder apart"),
        (["demo", "--num-shapes", "1"], "num-shapes"),
        (["align", "nowhere", "--out", "out", "-v"], "nowhere"),
        (["status", "nothing.sqlite"], "nothing.sqlite"),
        (["--config", "missing.toml", "align", ".", "--out", "out"], "missing.toml"),
    ],
)
def test_bad_arguments_exit_with_2_and_name_the_cause(arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.xyz").write_text("0 0 0\n")
    assert word in "".join(run_command(*arguments, ends=2)).lower()


def test_status_counts(finished):
    out, _ = finished
    report = json.loads(run_command("status", out / "store.sqlite", "--json").out)
    # Ten pairs, of which five were matched once more to see whether shapes are mirrored.
    assert (report["shapes"]["done"], report["pairs"]["done"], report["pairs"]["left"]) == (
        5,
        10,
        0,
    )
    assert report["run"] == {"files": "5", "stage": "finished"}
    assert (report["command"], report["exit_code"], report["finished"]) == ("status", 0, True)
    assert json.loads(run_command("status", out, "--json").out) == report


def test_status_of_an_unfinished_run_says_the_stage_and_how_to_go_on(tmp_path):
    with Store.open(tmp_path / "store.sqlite") as store:
        store.plan("shapes", {"a" * 40: "one.ply"})
        store.set_note("files", "3")
        store.set_note("stage", "confidence")
    said = run_command("status", tmp_path, ends=5).out
    assert "files: 3, of which 2 are duplicates" in said
    assert "shapes: 0 done, 0 failed, 1 left of 1" in said
    assert "stage: confidence" in said
    assert said.endswith("the same command continues it.\n")
    assert "the run is not finished" in run_command("status", tmp_path, "--prune", ends=2).err
    ended = run_command("status", tmp_path / "nowhere", "--prune", ends=2)
    assert "there is no such store" in ended.err


def test_status_of_a_result_whose_store_lies_elsewhere_asks_for_that(tmp_path):
    (tmp_path / EVIDENCE_FILE).touch()
    assert "Where --store named another file" in run_command("status", tmp_path, ends=2).err


def test_pruning_leaves_what_the_same_command_needs(folder, out):
    with Store.open(out / "store.sqlite") as store:
        store.put("pairs", "a" * 40, {"energy": 0.5})
    assert json.loads(run_command("status", out, "--prune", "--json").out)["removed"] == 1
    run_command("align", folder, "--out", out, "--no-report", *FLAGS)
    assert read_json(out / "run.json")["num_reused"] == 15


@pytest.fixture(scope="module")
def grown(planted, tmp_path_factory):
    """The folder of a run of four shapes to which the fifth was added, and the four as they were before."""
    root = tmp_path_factory.mktemp("grown")
    write_collection(root / "old", replace(planted, shapes=planted.shapes[:4]))
    write_mesh(root / "new" / "late.ply", planted.shapes[4])
    run_command("align", root / "old", "--out", root / "out", *FLAGS, "--no-report")
    before = read_json(root / "out" / "alignment.json")["shapes"]
    run_command("add", root / "out", root / "new", "--jobs", "1", "--no-report")
    return root, before


def test_adding_shapes_moves_nothing(grown, planted):
    out, before = grown[0] / "out", grown[1]
    after = read_json(out / "alignment.json")["shapes"]
    assert [s["transform"] for s in after[:4]] == [s["transform"] for s in before]
    assert [s["confidence"] for s in after[:4]] == [s["confidence"] for s in before]
    assert max(s["confidence"] for s in before) < 1.0
    assert after[4]["name"] == "late"
    linear = np.array([s["transform"] for s in after])[:, :3, :3]
    rotations = linear / np.cbrt(np.linalg.det(linear))[:, None, None]
    assert worst_error_deg(rotations, planted) < 15
    assert read_json(out / "run.json")["num_reused"] == 10


def test_an_inbox_is_added_again_and_again(folder, out, tmp_path):
    inbox, before = tmp_path / "inbox", (out / "alignment.json").read_bytes()
    command = ["add", str(out), str(inbox), "--jobs", "1", "--no-report"]
    shutil.copytree(folder, inbox)
    (inbox / "chair1.ply").rename(inbox / "another name.ply")
    assert len(json.loads(run_command(*command, "--json").out)["known"]) == 5
    assert (out / "alignment.json").read_bytes() == before
    write_mesh(
        inbox / "late.ply",
        read_shape(inbox / "chair2.ply").transformed(np.diag([2.0, 2.0, 2.0, 1.0])),
    )
    said = run_command(*command)
    assert (
        "Skipped 5 files that the collection has already: another name.ply (as chair1), "
        in said.out
    )
    assert len(read_json(out / "run.json")["known"]) == 5
    assert "nothing new to add" in run_command(*command).out
    write_mesh(
        inbox / "chair2.ply",
        read_shape(inbox / "chair2.ply").transformed(np.diag([3.0, 3.0, 3.0, 1.0])),
    )
    run_command(*command)
    shapes = read_json(out / "alignment.json")["shapes"]
    assert {"chair2", "inbox/chair2"} < {shape["name"] for shape in shapes}
    assert shapes[-1]["file"] == "inbox/chair2.ply"
    assert len({shape["digest"] for shape in shapes}) == len(shapes)


def test_a_renamed_file_is_known_though_another_has_its_name(planted, tmp_path):
    old, out = tmp_path / "old", tmp_path / "out"
    write_collection(old, replace(planted, shapes=planted.shapes[:4]))
    first, *_ = sorted(old.iterdir())
    align_collection(old, options=OPTIONS, run={"jobs": 1}, progress=False).save(out)
    before = load(out)
    write_mesh(first, planted.shapes[4])
    command = ["add", out, old, "--jobs", "1", "--no-report"]
    said = run_command(*command, ends=2)
    assert f"{first}: has changed since it was aligned as {first.stem}" in said.err
    write_mesh(old / "renamed.ply", planted.shapes[0])
    run_command(*command)
    after = load(out)
    assert after.names == (*before.names, f"old/{first.stem}")
    assert after.digests[:4] == before.digests
    assert after.file(0).name == "renamed.ply"
    np.testing.assert_array_equal(after.transforms[:4], before.transforms)


@pytest.mark.parametrize(
    ("stage", "what"), [("pairs", "has changed"), ("common matches", "has vanished")]
)
def test_a_file_that_changes_or_vanishes_during_a_run_is_named(planted, tmp_path, stage, what):
    write_collection(tmp_path / "in", replace(planted, shapes=planted.shapes[:3]))

    def display(description, total, *, done):
        if description == stage and what == "has changed":
            write_mesh(tmp_path / "in" / "chair3.ply", planted.shapes[4])
        elif description == stage:
            (tmp_path / "in" / "chair3.ply").unlink(missing_ok=True)
        return contextlib.nullcontext(lambda outcome: None)

    found = align_collection(tmp_path / "in", options=OPTIONS, jobs=1, progress=display)
    with pytest.raises(InputError, match=rf"chair3\.ply: {what} since the run began; .*run again"):
        found.save(tmp_path / "out")
    assert not list((tmp_path / "out").glob("*.json"))


def test_added_shapes_are_not_lost_when_the_first_command_runs_again(grown, tmp_path):
    old, new, out = (
        Path(shutil.copytree(grown[0] / name, tmp_path / name)) for name in ("old", "new", "out")
    )
    command = ["align", str(old), "--out", str(out), *FLAGS, "--no-report"]
    before = (out / "alignment.json").read_bytes()
    said = run_command(*command, ends=2)
    assert "has 1 more shapes, which would be lost: late. Name their files too" in said.err
    assert (out / "alignment.json").read_bytes() == before
    run_command(command[0], new, *command[1:])
    run_command(*command, "--exclude", "chair1", ends=2)
    run_command(*command, "--drop")
    assert "late" not in (out / "alignment.json").read_text()
    (old / "chair4.ply").unlink()
    run_command(*command)  # a shape whose file is gone is meant to go


def test_corrections_are_kept_without_matching_again(folder, out, tmp_path):
    command = ["align", str(folder), "--out", str(out), "--no-report", *FLAGS]
    shapes = read_json(out / "alignment.json")["shapes"]
    linear = np.array(shapes[2]["transform"])[:3, :3]
    flipped = np.diag([1.0, -1.0, -1.0]) @ linear / np.cbrt(np.linalg.det(linear))
    first, third = shapes[0]["name"], shapes[2]["name"]
    pose = {
        "shape": third,
        "decision": "pose",
        "rotation": flipped.tolist(),
        "compared_with": first,
    }
    frame = {first: np.eye(3).tolist()}
    decisions = {
        "format": "collalign-corrections",
        "version": 1,
        "frame": frame,
        "decisions": [pose],
    }
    (tmp_path / "decisions.json").write_text(json.dumps(decisions))
    run_command(*command, "--corrections", tmp_path / "decisions.json")
    corrected = np.array(read_json(out / "alignment.json")["shapes"][2]["transform"])[:3, :3]
    assert np.allclose(corrected / np.cbrt(np.linalg.det(corrected)), flipped)
    assert read_json(out / "run.json")["num_reused"] == 15
    again = read_json(out / "alignment.json")["shapes"]
    assert [shape["name"] for shape in again if shape.get("set_by_hand")] == [third]
    assert [shape["confidence"] for shape in again].count(1.0) == 1
    found = load(out)
    assert [*found.by_hand] == [third]
    assert found.by_hand[third] == again[2]["confidence_by_evidence"] < 0.5


def test_the_published_synchronization_runs_with_eigenfunctions(folder, planted):
    options = replace(
        OPTIONS, synchronization="spectral", embedding=EmbeddingOptions(kind="xyz+lb")
    )
    published = align_collection(folder, options=options, run=RunOptions(jobs=1))
    assert worst_error_deg(published.rotations, planted) < 20
    assert np.isnan(published.confidence).all()
    assert "no-confidence" in codes(published.notes)
