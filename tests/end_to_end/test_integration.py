"""Integration of blocks of landmarks is found from the files of shapes, as a user does it."""

import json

import numpy as np
import pytest

import collalign
from data_tools.datasets.synthetic import planted_collection
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.errors import InputError
from data_tools.options import SamplingOptions
from data_tools.surface.shape import Shape
from tests.commands import read_json, read_rows, run_command
from tests.finished_runs import finished_run, on_files, slicer_file
from tests.notes import codes, only

NUM, NUM_EACH = 12, 5
#: Where the horns are, by direction. The first two are as long as each other, the third is as long as it likes.
HORNS = np.array([[0.9, 0.4, 0.1], [-0.7, 0.6, 0.4], [0.1, -0.5, -0.9]])
LABELS = tuple(f"{horn} {at}" for horn in "abc" for at in range(NUM_EACH))
BLOCKS = ("left=a 0..a 4", "right=b 0..b 4", "other=c 0..c 4")


def planted():
    """Return ellipsoids with three horns in random poses, and the vertices that are landmarks."""
    rng = np.random.default_rng(11)
    sphere, faces = sphere_mesh(700)
    units = HORNS / np.linalg.norm(HORNS, axis=1, keepdims=True)
    near = [np.argsort(np.linalg.norm(sphere - unit, axis=1))[: 3 * NUM_EACH : 3] for unit in units]
    shapes = []
    for at in range(NUM):
        common, own = rng.uniform(0.1, 0.6, 2)
        vertices = sphere * [1.5, 1.0, 0.7]
        for unit, height in zip(units, (common, common, own), strict=True):
            bump = np.exp(-((sphere - unit) ** 2).sum(axis=1) / 0.1)
            vertices = vertices + height * bump[:, None] * unit
        shapes.append(Shape.from_arrays(vertices, faces, name=f"s{at:02}"))
    return planted_collection(shapes, rng, scale_range=(0.5, 2.0)), np.concatenate(near)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The result, and a file of landmarks of every shape."""
    folder = tmp_path_factory.mktemp("integration")
    collection, chosen = planted()
    options = collalign.AlignOptions(
        group="SO", sampling=SamplingOptions(num_points=24, num_dense_points=100)
    )
    files = [
        slicer_file(folder / f"{shape.name}.mrk.json", points, LABELS)
        for shape, points in zip(collection.shapes, on_files(collection, chosen), strict=True)
    ]
    return finished_run(folder, collection, options), files


def check_planted(folder):
    rows = read_rows(folder / "statistics" / "integration.csv")
    found = {
        (row["first"], row["second"]): row for row in rows if row["superimposed"] == "separately"
    }
    assert float(found["left", "right"]["r_PLS"]) > 0.8
    assert float(found["left", "right"]["P"]) <= 0.02
    others = [float(found[pair]["Z"]) for pair in (("left", "other"), ("right", "other"))]
    assert max(others) < float(found["left", "right"]["Z"])
    return rows


def test_horns_that_grow_together_are_found_by_all_landmarks_and_by_one_template(made, tmp_path):
    result, files = made
    words = ("variation", result, "--jobs", 1, "--permutations", 99, "--blocks", *BLOCKS)
    said = run_command(*words, "--to", tmp_path / "all", "--landmarks", *files)
    assert "Integration of left and right: r-PLS" in said.err
    assert "carries the landmarks" not in said.err
    assert len(check_planted(tmp_path / "all")) == 6
    page = (tmp_path / "all" / "variation.html").read_text("utf-8")
    assert "Integration of left and right" in page
    run = collalign.RunOptions(jobs=1, store=result / "store.sqlite")
    found = collalign.statistics.write_surface_variation(
        result,
        tmp_path / "one",
        landmarks=files[:1],
        tests={"blocks": BLOCKS, "permutations": 99},
        run=run,
    )
    only(found.notes, "blocks-carried")
    assert codes(found.notes).count("blocks-compared") == 3
    check_planted(tmp_path / "one")


def test_blocks_that_are_none_are_refused_before_anything_is_registered(made, tmp_path):
    result, files = made
    words = ("variation", result, "--to", tmp_path / "out", "--blocks")
    assert "name files" in run_command(*words, *BLOCKS, ends=InputError.exit_code).err
    wrong = (BLOCKS[0], "right=b 0..d 4", "--landmarks", files[0])
    assert "no landmark is called 'd 4'" in run_command(*words, *wrong, ends=2).err
    assert not (tmp_path / "out").exists()


#: Standard deviation of the second digitisation, in the unit of the files; of one landmark it is ten times as much.
HAND, SHAKY = 0.002, 7


def digitised_again(files, folder, skip=0):
    """Write files of landmarks that were placed again, but for the first ones, and return them."""
    rng = np.random.default_rng(12)
    folder.mkdir()
    for file in files[skip:]:
        marks = read_json(file)
        for at, control in enumerate(marks["markups"][0]["controlPoints"]):
            error = HAND * (10 if at == SHAKY else 1) * rng.standard_normal(3)
            control["position"] = (np.array(control["position"]) + error).tolist()
        (folder / file.name).write_text(json.dumps(marks))
    return sorted(folder.iterdir())


def test_landmarks_that_were_placed_again_tell_the_error_of_the_hand(made, tmp_path):
    result, files = made
    again = digitised_again(files, tmp_path / "again", skip=2)
    words = ("variation", result, "--jobs", 1, "--permutations", 99, "--to", tmp_path / "out")
    said = run_command(*words, "--landmarks", *files, "--repeats", *again)
    assert "from 22 measurements of 12 specimens" in said.err
    folder = tmp_path / "out" / "statistics"
    errors = {
        row["landmark"]: float(row["error"]) for row in read_rows(folder / "digitisation.csv")
    }
    assert max(errors, key=errors.get) == LABELS[SHAKY]
    others = [error for name, error in errors.items() if name != LABELS[SHAKY]]
    np.testing.assert_allclose(np.median(others), HAND * np.sqrt(3 / 2), rtol=0.2)
    (row, *_) = read_rows(folder / "measurement_error.csv")
    assert 0.9 < float(row["repeatability"]) < 1
    counts = [row["measurements"] for row in read_rows(folder / "repeats.csv")]
    assert sorted(counts) == ["1"] * 2 + ["2"] * 10


def test_repeats_without_a_first_digitisation_are_refused(made, tmp_path):
    result, files = made
    words = ("variation", result, "--to", tmp_path / "out", "--repeats")
    assert "name the files of the first" in run_command(*words, *files, ends=2).err
    same = (files[1], "--landmarks", *files)
    assert f"{files[1].name} is the first digitisation" in run_command(*words, *same, ends=2).err
    again = digitised_again(files[:1], tmp_path / "again")
    one = (again[0], "--landmarks", files[1])
    assert "measured twice" in run_command(*words, *one, ends=2).err
    assert not (tmp_path / "out").exists()
