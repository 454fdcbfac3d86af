import pytest

from collalign.tools.variation.mirror import landmark_partners, read_landmark_pairs
from data_tools.errors import InputError


def test_pairs_of_landmarks_come_from_a_table(tmp_path):
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
    for pairs in (
        (("nose", "nose"),),
        (("nose", "eye l"), ("eye r", "nose")),
        (("nose", "mouth"),),
    ):
        with pytest.raises(InputError, match="pairs"):
            landmark_partners(labels, pairs)
