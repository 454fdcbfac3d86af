"""Up, front and origin of the common frame, from the axes of a shape's file or from its landmarks."""

import csv

import numpy as np
import pytest

import collalign
from collalign import AlignOptions, align_collection
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import InputError, OptionsError
from data_tools.poses import moved_by
from tests.commands import read_json, run_command
from tests.finished_runs import chairs

OPTIONS = {"sampling": {"num_points": 24, "num_dense_points": 0}, "incomplete": "never"}
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def planted():
    return chairs(4)


@pytest.fixture(scope="module")
def marks(planted):
    """Landmarks of the second chair on its surface: the lowest and highest vertex, and those farthest to either side.

    In its own frame a chair's up is z, and its side y.
    """
    shape, pose = planted.shapes[1], planted.rotations[1]
    own = shape.vertices @ pose.T
    chosen = {
        "floor": own[:, 2].argmin(),
        "top": own[:, 2].argmax(),
        "left": own[:, 1].argmin(),
        "right": own[:, 1].argmax(),
    }
    return {name: shape.vertices[at] for name, at in chosen.items()}


@pytest.fixture(scope="module")
def align(planted, tmp_path_factory):
    """Aligns the chairs; all runs match the same pairs once."""
    run = {"jobs": 1, "store": tmp_path_factory.mktemp("frame") / "store.sqlite"}
    shapes = {shape.name: shape for shape in planted.shapes}

    def aligned(options=OPTIONS, **keywords):
        return align_collection(shapes, options=options, run=run, progress=False, **keywords)

    return aligned


def test_landmarks_turn_all_shapes_and_set_the_origin(align, planted, marks):
    name = planted.shapes[1].name
    found = align(up="floor:top", front="left:right", origin="floor", marks={name: marks})
    assert found.options.reference == name
    again = align(found.options)
    np.testing.assert_array_equal(
        again.transforms, found.transforms
    )  # the options alone repeat the run
    floor, top, left, right = (moved_by(found.transforms[1], marks[label]) for label in marks)
    np.testing.assert_allclose(floor, 0.0, atol=1e-12)
    np.testing.assert_allclose((top - floor) / np.linalg.norm(top - floor), UP, atol=1e-12)
    across = right - left
    assert across[1] == pytest.approx(0.0, abs=1e-12)
    assert across[0] > 0
    plain = align(reference=name)
    np.testing.assert_allclose(
        found.rotations[0].T @ found.rotations[2],
        plain.rotations[0].T @ plain.rotations[2],
        atol=1e-9,
    )


def test_axes_keep_the_frame_of_the_reference_and_are_recorded(align, planted, tmp_path):
    name = planted.shapes[1].name
    plain = align(reference=name)
    found = align(reference=name, up="y", front="-x", origin="file")
    np.testing.assert_array_equal(found.rotations, plain.rotations)
    np.testing.assert_allclose(found.transforms[1, :3, 3], 0.0, atol=1e-12)
    found.save(tmp_path / "out", report=False)
    record = read_json(tmp_path / "out" / "alignment.json")
    assert record["decided"]["frame"] == {"up": "y", "front": "-x"}


def test_the_command_line_reads_landmarks_and_added_shapes_keep_the_frame(planted, marks, tmp_path):
    first, rest = tmp_path / "first", tmp_path / "rest"
    files = write_collection(first, planted)
    rest.mkdir()
    files[3].rename(rest / files[3].name)
    (first / "truth.json").unlink(missing_ok=True)
    landmarks = tmp_path / f"{planted.shapes[1].name}.csv"
    with landmarks.open("w", newline="") as stream:
        rows = [[label, *point.tolist()] for label, point in marks.items()]
        csv.writer(stream).writerows([["label", "x", "y", "z"], *rows])
    options = [
        "--up",
        "floor:top",
        "--front",
        "left:right",
        "--origin",
        "top",
        "--marks",
        str(landmarks),
    ]
    options += [
        "--sampling.num-points",
        "24",
        "--sampling.num-dense-points",
        "0",
        "--incomplete",
        "never",
    ]
    out = tmp_path / "out"
    run_command("align", first, "--out", out, "--jobs", "1", "--no-report", *options)
    before = collalign.load(out)
    np.testing.assert_allclose(moved_by(before["chair2"].transform, marks["top"]), 0.0, atol=1e-6)
    run_command("add", out, rest, "--jobs", "1", "--no-report")
    after = collalign.load(out)
    assert len(after) == len(before) + 1
    np.testing.assert_array_equal(after.transforms[:-1], before.transforms)
    up = after.rotations[-1] @ planted.rotations[3].T @ UP
    assert up @ (after.rotations[1] @ planted.rotations[1].T @ UP) > 0.95


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"up": "floor:nowhere"}, "no landmark 'nowhere'; it has floor, top, left, right"),
        ({"up": "floor:top", "front": "floor:top"}, "the same direction"),
        ({"up": "floor:floor"}, "at the same place"),
        ({"up": "z", "origin": "seat"}, "no landmark 'seat'"),
        ({"up": "z", "reference": "chair1"}, "has no landmarks"),
    ],
)
def test_what_landmarks_cannot_say_is_refused(align, planted, marks, given, said):
    with pytest.raises(InputError, match=said):
        align(marks={planted.shapes[1].name: marks}, **given)


@pytest.mark.parametrize(
    "given",
    [
        *(
            {"up": "w"},
            {"up": "1,2"},
            {"up": "1,2,e"},
            {"up": "a:b:c"},
            {"up": ":b"},
            {"front": "x"},
            {"up": "z", "front": "-z"},
        ),
        {"up": "z", "gauge": "axes"},
    ],
)
def test_impossible_names_are_refused_at_once(given):
    with pytest.raises(OptionsError):
        AlignOptions(**given)


def test_landmarks_cannot_turn_what_a_person_fixed(align, planted, marks):
    name = planted.shapes[1].name
    with pytest.raises(OptionsError, match="name an axis"):
        align(up="floor:top", marks={name: marks}, fixed={name: np.eye(3)})
