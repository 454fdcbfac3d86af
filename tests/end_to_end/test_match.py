"""``collalign match`` on two files, rigid and deformable."""

import re

import numpy as np
import pytest
import trimesh

from collalign import match_rigid
from collalign.options import TwoShapeOptions
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import blob, crown, figure
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from tests.commands import read_json, read_rows, run_command
from tests.pairwise.test_partial_match import cut, moved


@pytest.fixture
def files(tmp_path, rng):
    shape = figure(resolution=1)
    turn = random_rotation(rng)
    moved = Shape.from_arrays(
        3.0 * shape.vertices @ turn + [1.0, 2.0, 3.0], shape.faces, name="moved"
    )
    return write_mesh(tmp_path / "a.ply", shape), write_mesh(tmp_path / "b.ply", moved), turn


def test_rigid_match_prints_and_writes_the_transform(files, tmp_path, capsys):
    target, source, turn = files
    run_command("match", target, source, "--out", tmp_path / "out")
    record = read_json(tmp_path / "out" / "match.json")
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("b -> a: energy")
    np.testing.assert_allclose(
        [[float(word) for word in line.split()] for line in printed[1:5]],
        record["transform"],
        rtol=1e-4,
    )
    assert re.match(r"Note: b was rescaled by a factor of 0\.3\d+: .*--partial", printed[5])
    assert record["scale"] == pytest.approx(1 / 3, rel=0.02)
    assert printed[6:] == [str(tmp_path / "out" / name) for name in ("match.json", "match.png")]
    transform = np.array(record["candidates"][0]["transform"])
    assert rotation_angle_deg(transform[:3, :3] * 3.0, turn) < 2.0
    assert np.linalg.det(transform[:3, :3]) == pytest.approx(1 / 27, rel=0.05)


def test_a_mirror_image_that_fits_much_better_is_said(tmp_path):
    """The answer stays a rotation, and poses are shown with what they are ranked by."""
    shape = blob(np.random.default_rng(4), num_vertices=400)
    turn = random_rotation(np.random.default_rng(5))
    mirrored = Shape.from_arrays(shape.vertices * [-1, 1, 1] @ turn + 3.0, shape.faces[:, ::-1])
    target, source = write_mesh(tmp_path / "c.ply", shape), write_mesh(tmp_path / "d.ply", mirrored)
    printed = run_command("match", target, source, "--out", tmp_path / "out").out
    record = read_json(tmp_path / "out" / "match.json")
    assert np.linalg.det(np.array(record["transform"])[:3, :3]) > 0
    assert "Note: The mirror image of d fits much better" in printed
    assert record["mirror_score"] < record["score"] / 1.5
    energies = [
        float(word)
        for word in re.findall(r"(?:energy|poses:) ([-+.e\d]+)", printed.splitlines()[0])
    ]
    assert energies == sorted(energies)
    printed = run_command("match", target, source, "--group", "O").out
    assert "Note" not in printed
    assert "reflected" in printed
    found = np.array(
        [[float(word) for word in line.split()] for line in printed.splitlines()[1:4]]
    )[:, :3]
    assert rotation_angle_deg(np.diag([-1.0, 1.0, 1.0]) @ found, turn) < 1.0


def test_objects_match_like_their_files(files):
    few = TwoShapeOptions(sampling=SamplingOptions(num_points=16))
    from_files = match_rigid(*files[:2], options=few)
    first, second = (read_shape(file) for file in files[:2])
    from_memory = match_rigid(first, (second.vertices, second.faces), options=few)
    np.testing.assert_array_equal(from_memory.transforms, from_files.transforms)
    np.testing.assert_array_equal(from_memory.transform, from_memory.transforms[0])
    assert rotation_angle_deg(from_memory.transform[:3, :3] * 3.0, files[2]) < 1.0
    assert (from_memory.source_file, from_files.source_file) == ("", str(files[1]))
    assert repr(from_files).startswith("<RigidMatch: b on a, energy")


def test_certify_reaches_the_pair(files, tmp_path):
    target, source, _ = files
    flags = ["--certify", "--matching.time-limit-s", "1", "--sampling.num-points", "8"]
    run_command("match", target, source, "--out", tmp_path / "out", *flags)
    record = read_json(tmp_path / "out" / "match.json")
    assert record["lower_bound"] <= record["energy"] * (1 + 1e-9)


def test_the_preset_of_the_paper_relaxes_the_pair_with_any_solver(files, tmp_path, rng):
    target, source, _ = files
    rough = read_shape(source)
    vertices = rough.vertices + 0.1 * rng.standard_normal(rough.vertices.shape)
    source = write_mesh(tmp_path / "c.ply", Shape.from_arrays(vertices, rough.faces))
    bounds = {}
    for solver in ("built-in", "clarabel"):
        flags = ["--preset", "paper", "--matching.solver", solver]
        flags += ["--sampling.num-points", "8", "--embedding.kind", "xyz"]
        run_command("match", target, source, "--out", tmp_path / solver, *flags)
        record = read_json(tmp_path / solver / "match.json")
        assert 0.0 < record["lower_bound"] <= record["energy"]
        assert all(one["refined"] is None for one in record["candidates"])
        bounds[solver] = record["lower_bound"]
    assert bounds["clarabel"] == pytest.approx(bounds["built-in"], rel=1e-2)
    assert bounds["clarabel"] != bounds["built-in"]
    partial = run_command("match", target, source, "--partial", "--preset", "paper", ends=2)
    assert "--preset are for samples" in partial.err


def test_nonrigid_match_writes_a_map_of_all_vertices(tmp_path, rng, capsys):
    shape = figure(resolution=2)
    marked = np.array([0, len(shape.vertices) // 2])
    for name in ("a", "stranger"):
        rows = (f"tip{v},{','.join(map(str, shape.vertices[v]))}\n" for v in marked)
        (tmp_path / f"{name}.csv").write_text("label,x,y,z\n" + "".join(rows))
    target = write_mesh(tmp_path / "a.ply", shape)
    source = write_mesh(tmp_path / "b.ply", bent(shape, rng, angle=0.3))
    flags = f"--nonrigid --surface.num-functions 40 --surface.num-dense 200 --out {tmp_path / 'o'}".split()
    run_command("match", target, source, *flags, "--landmarks", tmp_path / "stranger.csv", ends=2)
    assert not (tmp_path / "o").exists() or not any((tmp_path / "o").glob("map*"))
    run_command("match", target, source, *flags, "--landmarks", tmp_path / "a.csv")
    with np.load(tmp_path / "o" / "map.npz", allow_pickle=False) as arrays:
        there, back = arrays["point_map_target_source"], arrays["point_map_source_target"]
        confidence = arrays["vertex_confidence"]
    carried = read_rows(tmp_path / "o" / "map_landmarks.csv")
    places = np.array([[float(row[axis]) for axis in "xyz"] for row in carried])
    np.testing.assert_allclose(
        places, read_shape(source).vertices[back[marked]], rtol=1e-4, atol=1e-6
    )
    np.testing.assert_allclose(
        [float(row["confidence"]) for row in carried], confidence[back[marked]], rtol=1e-4
    )
    coloured = {
        end: trimesh.load(tmp_path / "o" / f"map_{end}.ply", process=False)
        for end in ("target", "source")
    }
    colours = {end: mesh.visual.vertex_colors[:, :3] for end, mesh in coloured.items()}
    assert np.array_equal(colours["source"], colours["target"][there])
    assert len(np.unique(colours["target"], axis=0)) > 100
    stored = coloured["source"].metadata["_ply_raw"]["vertex"]["data"]["confidence"].ravel()
    np.testing.assert_allclose(stored, confidence, rtol=1e-5)
    assert (tmp_path / "o" / "map.png").read_bytes().startswith(b"\x89PNG")
    assert "confidence" in capsys.readouterr().out
    np.savetxt(tmp_path / "c.xyz", shape.vertices)
    run_command("match", target, tmp_path / "c.xyz", *flags)
    assert not (tmp_path / "o" / "map_landmarks.csv").exists(), "of another map"
    assert b"property float confidence" in (tmp_path / "o" / "map_source.ply").read_bytes()


def test_surfaces_that_overlap_in_part_are_matched_and_say_so(tmp_path):
    rng = np.random.default_rng(1)
    whole, turn = crown(rng, num_vertices=700), random_rotation(rng)
    files = [str(write_mesh(tmp_path / "a.ply", whole))]
    part = cut(whole, np.array([1.0, 0.2, 0.0]), 0.3)
    files.append(
        str(write_mesh(tmp_path / "b.ply", moved(part, turn, 1.0, np.array([2.0, 0.0, 1.0]))))
    )
    flags = ["--partial", "--sampling.normalisation", "none"]
    printed = run_command("match", *files, *flags, "--out", tmp_path / "out").out
    assert " % of it lies on" in printed
    assert "mirror image" not in printed
    record = read_json(tmp_path / "out" / "match.json")
    assert rotation_angle_deg(np.array(record["transform"])[:3, :3] @ turn, np.eye(3)) < 5
    assert np.linalg.norm(np.array(record["transform"])[:3, 3] + turn.T @ [2.0, 0.0, 1.0]) < 0.2
    overlap = record["candidates"][0]["overlap"]
    assert overlap["source"] > 0.9 > overlap["target"] > 0.5
    assert 0.5 < record["confidence"] <= 1
    assert record["mirror_chance"] < 0.3
    other = Shape.from_arrays(part.vertices * [-1, 1, 1] @ turn, part.faces[:, ::-1])
    files.append(str(write_mesh(tmp_path / "c.ply", other)))
    said = run_command("match", files[0], files[2], *flags)
    assert "Note: The mirror image of c fits much better" in said.out
    for wrong in (
        "--landmarks a.csv",
        "--surface.num-dense 900",
        "--nonrigid --partial",
        "--nonrigid --group O",
    ):
        said = run_command("match", *files[:2], *wrong.split(), "--out", tmp_path / "o", ends=2)
        assert "--nonrigid" in said.err
    said = run_command("match", *files[:2], "--partial", "--certify", ends=2)
    assert "--partial works on surfaces" in said.err


def test_outputs_over_the_landmarks_of_a_shape_are_refused(files, tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    (marks / "some.csv").write_text("name,x,y,z\ntip,0,0,0\n")
    given = [*map(str, files[:2]), "--nonrigid", "--landmarks", f"a={marks / 'some.csv'}"]
    assert "contains" in run_command("match", *given, "--out", marks, ends=2).err
    said = run_command("match", given[0], given[0], *given[2:], "--out", tmp_path / "o", ends=2)
    assert "rename" in said.err
