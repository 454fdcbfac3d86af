"""Folders that are unusual but allowed: odd file names, the same file many times."""

from dataclasses import replace

import numpy as np
import pytest

from collalign import RunOptions, align_collection, load
from collalign.confidence.pose_model import MOST_CONFIDENT
from collalign.stages.match_pairs import match_pairs
from data_tools.datasets.synthetic import write_collection
from data_tools.io.shapes import write_mesh
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import rotation_angle_deg
from tests.commands import read_json, run_command
from tests.end_to_end.test_align import FLAGS, OPTIONS
from tests.finished_runs import chairs
from tests.notes import codes, only


@pytest.fixture(scope="module")
def planted():
    return chairs(4)


def test_equal_files_do_not_drown_the_one_that_differs(planted, tmp_path):
    for name in "abcde":
        write_mesh(tmp_path / f"{name}.ply", planted.shapes[0])
    write_mesh(tmp_path / "other.ply", planted.shapes[1])
    options = replace(OPTIONS, sampling=SamplingOptions(num_points=24, num_dense_points=100))
    found = align_collection(tmp_path, options=options, run=RunOptions(jobs=1))
    assert np.allclose(found.rotations[:5], np.eye(3), atol=1e-6)
    assert rotation_angle_deg(found.rotations[5], planted.relative_rotation(0, 1)) < 15


def test_copies_of_one_shape_are_sure_and_copies_of_a_box_fit_in_four_poses(rng):
    sampling = SamplingOptions(num_points=24, num_dense_points=100)
    options = replace(OPTIONS, sampling=sampling, embedding=EmbeddingOptions(kind="xyz"))
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-2.0, 2.0) for z in (-3.0, 3.0)])
    copies = align_collection([rng.random((200, 3))] * 6, options=options, run=RunOptions(jobs=1))
    assert (copies.confidence > 0.9).all()
    assert "symmetric" not in codes(copies.notes)
    boxes = align_collection([corners] * 6, options=options, run=RunOptions(jobs=1))
    assert (boxes.confidence == MOST_CONFIDENT / 4).all()
    assert only(boxes.notes, "symmetric").values["num"] == 6


def test_a_shape_without_any_pair_is_named_first(planted, tmp_path, monkeypatch):
    def match_all_but_the_last(*args, **options):
        pairs, failed = match_pairs(*args, **options)
        return [pair for pair in pairs if 3 not in (pair.target, pair.source)], failed

    monkeypatch.setattr("collalign.stages.choose_pairs.match_pairs", match_all_but_the_last)
    write_collection(tmp_path / "shapes", planted)
    printed = run_command(
        "align", tmp_path / "shapes", "--out", tmp_path / "out", "--no-report", *FLAGS
    ).out
    assert "look at them first: chair4 (unknown)" in printed
    assert "No pairs connect" in printed
    shapes = read_json(tmp_path / "out" / "alignment.json")["shapes"]
    assert shapes[3]["confidence"] is None
    assert np.isfinite(shapes[3]["transform"]).all()


def test_samples_are_vertices_of_the_file_whatever_cleaning_drops_and_notes_say_what(
    planted, tmp_path
):
    fragment = np.array([[9.0, 9.0, 9.0], [9.1, 9.0, 9.0], [9.0, 9.1, 9.0]])
    stored = [
        np.vstack([fragment, shape.vertices, shape.vertices[:5]]) for shape in planted.shapes[:3]
    ]
    stored[1][[3, 6], 1] = np.nan
    for shape, vertices in zip(planted.shapes, stored, strict=False):
        faces = np.vstack([[[0, 1, 2]], shape.faces + 3])
        write_mesh(tmp_path / f"{shape.name}.ply", replace(shape, vertices=vertices, faces=faces))
    said = run_command("align", tmp_path, "--out", f"{tmp_path}-out", *FLAGS).out
    assert "dropped" in said
    notes = read_json(tmp_path.parent / f"{tmp_path.name}-out" / "alignment.json")["shape_notes"]
    assert "non-finite-dropped" in codes(notes[planted.shapes[1].name])
    assert all("components-kept" in codes(notes[shape.name]) for shape in planted.shapes[:3])
    with np.load(f"{tmp_path}-out/correspondences.npz") as found:
        transforms = load(f"{tmp_path}-out").transforms
        for i, vertices in enumerate(stored):
            moved = (
                vertices[found["vertex_indices"][i]] @ transforms[i, :3, :3].T
                + transforms[i, :3, 3]
            )
            assert np.allclose(moved, found["positions"][i], atol=1e-5)
