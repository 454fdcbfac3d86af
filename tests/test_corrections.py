import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.corrections import FORMAT, read_corrections
from data_tools.errors import InputError

R = Rotation.random(4, random_state=1).as_matrix()
NAMES = ["a", "b", "c", "d"]


def record(**changes: Any) -> dict[str, Any]:
    """Two decisions about four shapes, as the report writes them."""
    flipped = np.diag([1.0, -1.0, -1.0]) @ R[1]
    return {
        "format": FORMAT,
        "version": 1,
        "decisions": [
            {"shape": "b", "decision": "pose", "rotation": flipped.tolist()},
            {"shape": "c", "decision": "confirmed", "rotation": R[2].tolist()},
        ],
        "frame": {name: matrix.tolist() for name, matrix in zip(NAMES, R, strict=True)},
    } | changes


def write(tmp_path: Path, content: Any) -> Path:
    path = tmp_path / "corrections.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_decisions_come_back(tmp_path: Path) -> None:
    found = read_corrections(write(tmp_path, record()))
    assert [(decision.shape, decision.kind) for decision in found.decisions] == [("b", "pose"), ("c", "confirmed")]
    indices, rotations = found.fixed(["c", "x", "b"])
    assert indices.tolist() == [2, 0]
    np.testing.assert_allclose(rotations[1], R[2], atol=1e-12)


def test_constraints_hold_in_every_gauge(tmp_path: Path) -> None:
    found = read_corrections(write(tmp_path, record()))
    edges, relative = found.constraints(["z", *NAMES])
    assert len(edges) == len({frozenset(edge) for edge in edges.tolist()}) == 5
    assert not (edges == 0).any()
    right = R.copy()
    right[1] = np.diag([1.0, -1.0, -1.0]) @ R[1]
    gauge = Rotation.random(random_state=5).as_matrix()
    for (i, j), R_i_j in zip(edges - 1, relative, strict=True):
        np.testing.assert_allclose(R_i_j, (gauge @ right[i]).T @ (gauge @ right[j]), atol=1e-12)


def test_no_decisions_demand_nothing(tmp_path: Path) -> None:
    edges, relative = read_corrections(write(tmp_path, record(decisions=[]))).constraints(NAMES)
    assert edges.shape == (0, 2)
    assert relative.shape == (0, 3, 3)


def test_decisions_about_shapes_that_are_not_there_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'c' is no shape of this collection"):
        read_corrections(write(tmp_path, record())).constraints(["a", "b"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "cannot be read as JSON"),
        ("[" * 100_000, "cannot be read as JSON"),
        ([], "not a file of decisions"),
        ({"format": "other"}, "not a file of decisions"),
        (record(version=2), "version 2"),
        (record(frame=[]), "'frame' an object"),
        (record(decisions=[{"shape": "b"}]), "decision 1: expected 'shape'"),
        (record(decisions=[{"shape": "b", "decision": "pose", "rotation": "x"}]), "decision 1"),
        (record(decisions=[{"shape": "b", "decision": "pose", "rotation": [[1, 0], [0, 1]]}]), "3 x 3"),
        (
            record(decisions=[{"shape": "b", "decision": "pose", "rotation": np.ones((3, 3)).tolist()}]),
            "not orthogonal",
        ),
        (record(decisions=record()["decisions"][:1] * 2), "two decisions about 'b'"),
        (record(frame={"a": R[0].tolist()}), "the frame lacks 'b'"),
    ],
)
def test_damaged_files_are_refused_with_advice(tmp_path: Path, content: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_corrections(write(tmp_path, content))
