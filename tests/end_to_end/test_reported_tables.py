"""Tables as people reported them: beside meshes, with something before x, y and z, with a count that is off."""

import json

import numpy as np
import pytest
import trimesh

from collalign import RunOptions, add_to_collection, align_collection, load
from data_tools.errors import InputError
from data_tools.rotations import random_rotation, rotation_angle_deg
from tests.commands import run_command
from tests.end_to_end.test_reported_inputs import bumpy
from tests.finished_runs import angles_deg

RUN = RunOptions(jobs=1)
FLAGS = ("--jobs", "1", "--no-report", "--sampling.num-points", "24")


def written(path, rows, form="%.6f", sep=" ", head=""):
    """Write rows of numbers below a heading and return the path."""
    path.write_text(head + "".join(sep.join(form % x for x in row) + "\n" for row in rows))
    return path


@pytest.fixture(scope="module")
def classified(tmp_path_factory):
    """Clouds whose rows begin with a class, and the rotation of each."""
    folder, rng, turns = tmp_path_factory.mktemp("classified"), np.random.default_rng(1), []
    for number in range(4):
        turns.append(random_rotation(rng))
        points = bumpy(number, 2)[0] @ turns[-1].T
        written(folder / f"c{number}.txt", np.c_[rng.integers(1, 4, len(points)), points], "%.7g")
    return folder, np.array(turns)


def test_a_class_before_the_coordinates_is_refused_until_somebody_names_it(classified, tmp_path):
    folder, turns = classified
    said = run_command("align", folder, "--check", *FLAGS[:3], ends=2).err
    assert said.count("x, y, z, ..., or as number, x, y, z. Say which with --columns x,y,z or") == 4
    columns = ("--columns", "class,x,y,z")
    assert "4 of 4 files" in run_command("align", folder, "--check", *FLAGS[:3], *columns).out
    some = [folder / f"c{number}.txt" for number in range(3)]
    run_command("align", *some, "--out", tmp_path / "out", *FLAGS, *columns)
    found = load(tmp_path / "out")
    assert found.options.cleaning.columns == "class,x,y,z"
    assert angles_deg(found.rotations @ turns[:3]).max() < 10.0
    run_command("add", tmp_path / "out", folder, "--jobs", "1", "--no-report")
    assert angles_deg(load(tmp_path / "out").rotations @ turns).max() < 10.0
    run_command("match", *some[:2], ends=2)
    printed = run_command("match", *some[:2], *columns).out.splitlines()
    matched = np.array([line.split() for line in printed[1:4]], dtype=float)[:, :3]
    assert rotation_angle_deg(matched / np.cbrt(np.linalg.det(matched)), turns[0] @ turns[1].T) < 10


def test_columns_are_named_in_batches_and_for_new_tables_alone(classified, tmp_path):
    folder, turns = classified
    (tmp_path / "plain").mkdir()
    for number in range(3):
        points = np.loadtxt(folder / f"c{number}.txt")[:, 1:]
        written(tmp_path / "plain" / f"p{number}.xyz", points)
    (tmp_path / "batch.toml").write_text(
        f"[options.sampling]\nnum_points = 24\n[[jobs]]\nfolder = {json.dumps(str(folder))}\nout = 'b'\n"
        "[jobs.options.cleaning]\ncolumns = 'class,x,y,z'\n"
    )
    run_command("batch", tmp_path / "batch.toml", "--jobs", "1")
    assert len(load(tmp_path / "b")) == 4
    aligned = align_collection(
        tmp_path / "plain", run=RUN, progress=False, sampling={"num_points": 24}
    )
    aligned.save(tmp_path / "o", report=False)
    with pytest.raises(InputError, match="the result was made with 'class,x,y,z'"):
        add_to_collection(
            tmp_path / "b", [folder / "c3.txt"], columns="x,y,z,class", progress=False
        )
    more = tmp_path / "c9.csv"
    headed = np.loadtxt(folder / "c3.txt")
    written(more, headed[:, [1, 2, 3, 0]], sep=",", head="x,y,z,class\n")
    found = add_to_collection(tmp_path / "o", [more], run=RUN, progress=False)
    assert angles_deg(found.rotations @ turns[[3, 0, 1, 2]][[1, 2, 3, 0]]).max() < 10.0


def test_a_worn_surface_is_laid_on_what_is_left_of_it(tmp_path):
    """The top is cut flat; what did not change lies where it was, at its own size, where ``match`` says otherwise."""
    whole, faces = bumpy(3, 5)
    worn, coarse = bumpy(3, 4)
    top = whole[:, 2].max()
    worn[:, 2] = np.minimum(worn[:, 2], top - 0.35)
    turn = random_rotation(np.random.default_rng(1))
    moved = 5.0 * worn @ turn.T + [3.0, -5.0, 2.0]
    trimesh.Trimesh(5.0 * whole, faces, process=False).export(tmp_path / "t0.stl")
    trimesh.Trimesh(moved, coarse, process=False).export(tmp_path / "t1.stl")
    said = run_command("match", "--partial", tmp_path / "t0.stl", tmp_path / "t1.stl", "--json").out
    assert json.loads(said)["scale"] == pytest.approx(1.0, abs=1e-6)
    partial = np.array(json.loads(said)["transform"])
    assert rotation_angle_deg(partial[:3, :3], turn.T) < 0.6
    kept = worn[:, 2] < top - 0.6
    off = moved[kept] @ partial[:3, :3].T + partial[:3, 3] - 5.0 * worn[kept]
    shares = np.linalg.norm(off, axis=1) / np.linalg.norm(np.ptp(5.0 * whole, axis=0))
    assert np.median(shares) < 0.003
    assert shares.max() < 0.005
    trimesh.Trimesh(1.25 * moved, coarse, process=False).export(tmp_path / "t2.stl")
    said = run_command("match", tmp_path / "t0.stl", tmp_path / "t2.stl", "--json").out
    scale = json.loads(said)["scale"]
    assert scale == pytest.approx(0.8, abs=0.05)
    said = run_command("match", tmp_path / "t0.stl", tmp_path / "t2.stl").out
    assert f"t2 was rescaled by a factor of {scale:.4g}" in said
