import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.output.corrections import FORMAT, fixed_by, read_corrections
from data_tools.errors import InputError

R = Rotation.random(4, random_state=1).as_matrix()
NAMES = ["a", "b", "c", "d"]


def record(**changes):
    """Two decisions about four shapes, as the report writes them."""
    flipped = np.diag([1.0, -1.0, -1.0]) @ R[1]
    return {
        "format": FORMAT,
        "version": 1,
        "decisions": [
            {"shape": "b", "decision": "pose", "rotation": flipped.tolist()},
            {"shape": "c", "decision": "confirmed", "rotation": R[2].tolist()},
        ],
        "frame": {name: matrix.tolist() for name, matrix in zip("ad", R[[0, 3]], strict=True)},
    } | changes


def placed(shape="b", **changes):
    """A decision that places a shape."""
    pose = {"rotation": R[1].tolist(), "translation": [1.0, 2.0, 3.0], "scale": 0.5}
    return {"shape": shape, "decision": "pose"} | pose | changes


def write(tmp_path, content):
    path = tmp_path / "corrections.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_certain_shapes_stay_and_decided_ones_move(tmp_path):
    found = read_corrections(write(tmp_path, record()))
    assert (list(found.decisions), found.source) == (["b", "c"], str(tmp_path / "corrections.json"))
    fixed, kept = fixed_by([found], ["z", *NAMES])
    assert (set(fixed), set(kept)) == ({*"bc"}, {*"ad"})  # only what a person decided is certain
    np.testing.assert_allclose(kept["a"], R[0], atol=1e-12)
    np.testing.assert_allclose(fixed["b"], np.diag([1.0, -1.0, -1.0]) @ R[1], atol=1e-12)


def test_decisions_by_names_that_nearly_agree_are_taken_and_said(tmp_path, caplog):
    fixed, kept = fixed_by([read_corrections(write(tmp_path, record()))], ["A", "b", "_C", "d"])
    assert (set(fixed), set(kept)) == ({"b", "_C"}, {"A", "d"})
    assert "'c' is taken as '_C'" in caplog.text


def test_decisions_about_shapes_that_are_not_there_are_refused(tmp_path):
    with pytest.raises(InputError, match="'c' is no shape of this collection"):
        fixed_by([read_corrections(write(tmp_path, record()))], ["a", "b"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("9" * 10_000, "cannot be read as JSON"),
        ("[" * 100_000, "cannot be read as JSON"),
        ([], "not a file of decisions"),
        ({"format": "other"}, "not a file of decisions"),
        (record(version=3), "version 3"),
        (record(frame=[]), "'frame' an object"),
        (record(decisions=[{"shape": "b"}]), "decision 1: expected 'shape'"),
        (record(decisions=[{"shape": "b", "decision": "pose", "rotation": "x"}]), "decision 1"),
        (
            record(decisions=[{"shape": "b", "decision": "pose", "rotation": [[1, 0], [0, 1]]}]),
            "3 x 3",
        ),
        (
            record(decisions=[{"shape": "b", "decision": "pose", "rotation": [[10**400] * 3] * 3}]),
            "decision 1",
        ),
        (record(frame={"a": [[10**400] * 3] * 3}), "frame of 'a'"),
        (
            record(
                decisions=[{"shape": "b", "decision": "pose", "rotation": np.ones((3, 3)).tolist()}]
            ),
            "not orthogonal",
        ),
        (record(decisions=record()["decisions"][:1] * 2), "two decisions about 'b'"),
        (
            record(incomplete=["c"], decisions=[placed()]),
            "'b' has a translation and a scale, but is complete",
        ),
        (record(incomplete=["b"], decisions=[placed(scale=0)]), r"decision 1 \(b\): scale is 0"),
        (record(incomplete=["b"], decisions=[placed(scale=None)]), r"decision 1 \(b\), scale"),
        (
            record(incomplete=["b"], decisions=[placed(translation=[1, [2]])]),
            "translation: expected 3 finite",
        ),
        (record(incomplete="b"), "'decisions' and 'incomplete' must be lists"),
    ],
)
def test_damaged_files_are_refused_with_advice(tmp_path, content, message):
    with pytest.raises(InputError, match=message):
        read_corrections(write(tmp_path, content))


def test_files_of_several_pages_are_kept_together(tmp_path):
    first = read_corrections(write(tmp_path, record()))
    turned, other = first.decisions["b"], next(iter(first.frame))
    files = [
        replace(first, decisions={"b": turned}),
        replace(first, decisions={other: turned}, frame={}, source="second"),
    ]
    fixed, kept = fixed_by(files, NAMES)
    assert np.array_equal(fixed["b"], turned)
    assert np.array_equal(fixed[other], turned)  # and not as the first file's frame has it
    assert fixed.keys() == {other, "b"}
    assert kept.keys() == first.frame.keys() - {other}
    assert fixed_by([], NAMES) == ({}, {})
    with pytest.raises(InputError, match="second: another file decides about 'b'"):
        fixed_by([files[0], replace(files[0], source="second")], NAMES)


def test_incomplete_shapes_are_placed_among_whole_poses(tmp_path):
    frame = {
        name: {key: placed()[key] for key in ("rotation", "translation", "scale")} for name in "ad"
    }
    found = read_corrections(
        write(tmp_path, record(version=2, decisions=[placed()], frame=frame, incomplete=["b"]))
    )
    pose = fixed_by([found], NAMES)[0]["b"]
    np.testing.assert_allclose(
        pose, np.vstack([np.column_stack([0.5 * R[1], [1, 2, 3]]), [0, 0, 0, 1]])
    )
    assert found.frame["a"].shape == (4, 4)
    for told in ("auto", "all", "c, b"):
        assert [set(poses) for poses in fixed_by([found], NAMES, told)] == [{"b"}, {*"ad"}]
    beside = replace(found, incomplete=("b", "d"))
    assert [set(poses) for poses in fixed_by([beside], NAMES)] == [{"b"}, {*"ad"}]
    for told in ("never", "c"):
        with pytest.raises(InputError, match="'b' was incomplete there; name it in --incomplete"):
            fixed_by([found], NAMES, told)
    with pytest.raises(InputError, match="none of the shapes that it refers to"):
        fixed_by([replace(found, frame={"a": R[0]})], NAMES)
