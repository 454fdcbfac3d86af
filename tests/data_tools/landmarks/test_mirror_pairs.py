from pathlib import Path

import pytest

from data_tools.errors import InputError
from data_tools.landmarks.mirror_pairs import (
    landmark_partners,
    read_landmark_pairs,
    read_symmetry,
    read_vertex_indices,
)


def test_vertex_indices(tmp_path: Path) -> None:
    path = tmp_path / "a.pid"
    path.write_text(" 7 0 0 0\n3 0 0 0\n\n")
    assert read_vertex_indices(path, num_vertices=8).tolist() == [7, 3]
    with pytest.raises(InputError, match="below 7"):
        read_vertex_indices(path, num_vertices=7)


def test_symmetry_is_an_involution(tmp_path: Path) -> None:
    path = tmp_path / "a.sym.info"
    path.write_text("0 3\n1 2 \n\n4\n")
    partner = read_symmetry(path, num_landmarks=6)
    assert partner.tolist() == [3, 2, 1, 0, 4, 5]
    for content in ("0 6\n", "0 1 2\n", "a b\n", "0 1\n1 2\n"):
        path.write_text(content)
        with pytest.raises(InputError, match="line"):
            read_symmetry(path, num_landmarks=6)


def test_pairs_of_landmarks_come_from_a_table(tmp_path: Path) -> None:
    labels = ("nose", "eye l", "eye r", "ear l", "ear r")
    path = tmp_path / "pairs.csv"
    for header in ("", "left,right\n"):
        path.write_text(header + "eye l, eye r\n\near r,ear l\n")
        pairs = read_landmark_pairs(path, labels)
        assert pairs == (("eye l", "eye r"), ("ear r", "ear l"))
        assert landmark_partners(labels, pairs).tolist() == [0, 2, 1, 4, 3]
    for text, words in (
        ("eye l,eye r,nose\n", "two landmarks"),
        ("eye l,\n", "two landmarks"),
        ("eye l,eye x\n", "no landmark 'eye x'"),
        ("left,right\n", "no pairs"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            read_landmark_pairs(path, labels)
    for pairs in ((("nose", "nose"),), (("nose", "eye l"), ("eye r", "nose")), (("nose", "mouth"),)):
        with pytest.raises(InputError, match="pairs"):
            landmark_partners(labels, pairs)
