"""Landmarks of two templates that are the same, though they are called otherwise."""

import numpy as np
import pytest

from collalign.template_landmarks.table import (
    called_like,
    landmark_table,
    may_be_one,
    with_one_spelling,
)
from data_tools.errors import InputError
from data_tools.landmark_files import Landmarks, Semilandmarks
from data_tools.notes import Note


def marks(*labels, curves=()):
    points = np.arange(3.0 * len(labels)).reshape(-1, 3)
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    along = tuple(Semilandmarks(name=name, kind="open curve", points=line) for name in curves)
    return Landmarks(labels=labels, points=points, semilandmarks=along)


def numbered(prefix, numbers):
    return marks(*(f"{prefix}{at}" for at in numbers))


@pytest.mark.parametrize(
    ("own", "other", "labels", "how"),
    [
        (
            numbered("skullB_LM1-", range(1, 10)),
            numbered("skullA_LM1-", range(1, 10)),
            None,
            "by-order",
        ),
        (numbered("F-", range(10, 19)), numbered("F-", range(1, 10)), None, "by-order"),
        (numbered("F-", range(3, 12)), numbered("F-", range(1, 10)), None, "by-order"),
        (numbered("", range(1, 4)), numbered("", range(3)), None, "by-order"),
        (numbered("S00", range(3)), numbered("F_", range(1, 4)), None, "by-order"),
        (numbered("B-", (1, 3)), numbered("A-", (1, 2, 3)), ("A-1", "A-3"), "without-prefix"),
        (
            marks("b_nasion", "b_bregma"),
            marks("a_bregma", "a_nasion"),
            ("a_nasion", "a_bregma"),
            "without-prefix",
        ),
        (marks("p", "q"), marks("q", "r"), ("p", "q"), ""),
        (marks("F-2", "F-1"), marks("F-1", "F-2"), ("F-2", "F-1"), ""),
        (marks("p", "q"), marks("r", "s"), ("p", "q"), ""),
        (numbered("F-", (1, 2)), numbered("F-", (1, 2, 3)), ("F-1", "F-2"), ""),
    ],
)
def test_labels_that_differ_by_prefix_or_numbers_are_matched(own, other, labels, how):
    found, said = called_like(own, other)
    assert found.labels == (other.labels if labels is None else labels)
    assert said == how


def test_curves_that_are_called_after_their_lists_are_matched_by_their_order():
    found, said = called_like(
        marks("p", curves=("B_rim", "B_ridge")), marks("p", curves=("A_rim", "A_ridge"))
    )
    assert [one.name for one in found.semilandmarks] == ["A_rim", "A_ridge"]
    assert said == "curves-by-order"
    found, said = called_like(marks("p", curves=("ridge",)), marks("p", curves=("rim", "ridge")))
    assert ([one.name for one in found.semilandmarks], said) == (["ridge"], "")


def test_a_table_says_what_it_matched_and_refuses_what_nothing_matches():
    poses = dict.fromkeys("ab", np.eye(4))
    table = landmark_table(
        {"a": numbered("A-", range(1, 4)), "b": numbered("B-", range(1, 4))}, poses
    )
    assert table.labels == ("A-1", "A-2", "A-3")
    assert all(np.isfinite(points).all() for points in table.points.values())
    assert table.notes == (Note("landmarks-renamed", ("b",), {"template": "a", "how": "by-order"}),)
    with pytest.raises(
        InputError, match=r"no landmark \('p', 'q'\) has the name of one of a .*same labels"
    ):
        landmark_table({"a": numbered("A-", range(1, 4)), "b": marks("p", "q")}, poses)


@pytest.mark.parametrize(
    ("labels", "respelt"),
    [
        (("lM1", "LM2"), ("LM1", "LM2")),
        (("lm_01", "LM 2"), ("LM1", "LM2")),
        (("LM1", "lm1"), ("LM1", "lm1")),
        (("LM10", "LM12"), ("LM10", "LM12")),
        (("LM1-1", "LM11"), ("LM1-1", "LM11")),
    ],
)
def test_labels_are_spelt_as_most_templates_spell_them(labels, respelt):
    given = {"a": marks(*labels), "b": marks("LM1", "LM2"), "c": marks("LM1", "LM2")}
    found, notes = with_one_spelling(given)
    assert found["a"].labels == respelt
    assert [found[name].labels for name in "bc"] == [("LM1", "LM2")] * 2
    assert [note.shapes for note in notes] == ([("a",)] if labels != respelt else [])


def test_a_landmark_under_another_number_takes_the_other_name():
    poses = dict.fromkeys("ab", np.eye(4))
    given = {"a": marks("F-1", "F-2", "F-3", curves=("rim",)), "b": marks("F-1", "F-2", "F-10")}
    table = landmark_table(given, poses)
    assert table.labels == ("F-1", "F-2", "F-3", "rim-1", "rim-2", "F-10")
    renamed = table.renamed({"b": {"F-10": "F-3"}})
    assert renamed.labels == ("F-1", "F-2", "F-3", "rim-1", "rim-2")
    np.testing.assert_array_equal(renamed.points["b"][2], given["b"].points[2])
    np.testing.assert_array_equal(renamed.points["a"], table.points["a"][:5])
    assert renamed.semilandmarks == table.semilandmarks
    assert may_be_one("F-3", "F-10")
    assert not may_be_one("nasion", "F-3")
    assert not may_be_one("F-3", "G-3")
