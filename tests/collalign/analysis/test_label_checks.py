"""What is wrong with labels, by itself and against what was found."""

import numpy as np
import pytest

from collalign.analysis.label_checks import (
    copy_contradictions,
    side_contradictions,
    size_contradictions,
    stranger_labels,
    typing_errors,
    wrong_cells,
)
from data_tools.embedding.copies import Copies
from data_tools.notes import Note

NAMES = [*"abcdefghijkl"]


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ([*"123456789", "6O", "", "11"], {"j": "6O"}),
        ([*"123456789", "inf", "1e3", "-2.5"], {"j": "inf"}),
        ([*"123456789", "1_0", "1e3", "-2.5"], {"j": "1_0"}),
        ([*"123456789", "", "", ""], {}),
        ([*"123456", *"x" * 6], None),
        (["f", "m"] * 6, None),
        (["1", "2", "x"], None),  # too few to tell
        ([""] * 12, None),
    ],
)
def test_a_column_is_numbers_but_for_a_few_cells(values, found):
    assert wrong_cells(values, NAMES[: len(values)]) == found


@pytest.mark.parametrize(
    ("groups", "found"),
    [
        (["female"] * 5 + ["male"] * 6 + ["femal"], {"femal": "female"}),
        (["female"] * 5 + ["male"] * 6 + ["Female "], {"Female ": "female"}),
        (
            ["Pan paniscus"] * 6 + ["Pan panicsus"] + ["Gorilla"] * 5,
            {"Pan panicsus": "Pan paniscus"},
        ),
        (["Pan_paniscus"] * 6 + ["pan paniscus"] * 6, {"pan paniscus": "Pan_paniscus"}),
        (["female"] * 5 + ["male"] * 7, {}),
        (["site1"] * 6 + ["site2"] + ["site3"] * 5, {}),
        (["alba"] * 6 + ["alta"] * 6, {}),  # as common
        (["M"] * 6 + ["F"] + ["?"] * 5, {}),
        (["cat"] * 11 + ["rat"], {}),
        ([f"tooth {a}" for a in NAMES], {}),  # a name for each
    ],
)
def test_groups_that_are_misspelt_are_named(groups, found):
    notes = typing_errors({"x": groups}, NAMES)
    said = {
        group: similar
        for note in notes
        for group, similar in zip(note.values["groups"], note.values["similar"], strict=True)
    }
    assert said == found
    assert all(groups[NAMES.index(name)] in found for note in notes for name in note.shapes)


def test_labels_of_sides_are_compared_with_what_was_found():
    every, reflected = np.ones(12, dtype=bool), np.arange(12) < 5
    right = ["Left"] * 5 + ["right"] * 7
    assert side_contradictions({"side": right}, NAMES, reflected, every) == []
    assert side_contradictions({"side": right}, NAMES, ~reflected, every) == []
    wrong = [*right[:2], "R.", *right[3:11], ""]
    (note,) = side_contradictions({"side": wrong, "sex": [*"fm"] * 6}, NAMES, reflected, every)
    fields = {"column": "side", "labels": ("R.",), "num_agree": 10, "total": 11}
    assert note == Note("labels-of-sides", ("c",), fields)
    other_part = np.arange(12) != 2
    assert side_contradictions({"side": wrong}, NAMES, reflected, other_part) == []
    (unseen,) = side_contradictions({"side": right}, NAMES, np.zeros(12, dtype=bool), every)
    assert unseen.code == "labels-of-sides-unseen"
    one_side = ["L"] * 12
    (note,) = side_contradictions({"side": one_side}, NAMES, reflected, every)
    assert note.shapes == tuple("abcde")
    assert side_contradictions({"form": ["l"] * 3 + ["x"] * 9}, NAMES, reflected, every) == []


def test_copies_with_different_labels_contradict_them():
    columns = {
        "sex": [*"fmfmfmfmfmfm"],
        "side": [*"lrlrlrlrlrlr"],
        "number": [*map(str, range(12))],
    }
    (sex, side) = copy_contradictions(columns, NAMES, [Copies(names=("a", "b"), kind="moved")])
    assert sex == Note("labels-of-copies", ("a", "b"), {"column": "sex", "labels": ("f", "m")})
    assert side.values["column"] == "side"
    mirrored = [Copies(names=("a", "b"), kind="mirrored")]
    assert [note.values["column"] for note in copy_contradictions(columns, NAMES, mirrored)] == [
        "sex"
    ]
    assert copy_contradictions(columns, NAMES, [Copies(names=("a", "c"), kind="moved")]) == []


def test_shapes_like_no_other_are_told_with_the_labels_they_share():
    columns = {"species": ["Pan"] * 11 + ["Homo"], "sex": [*"fm"] * 6}
    (note,) = stranger_labels(columns, NAMES, ["b"])
    assert note == Note("labels-of-strangers", ("b",), {"labels": ("species Pan", "sex m")})
    assert stranger_labels({"species": columns["species"]}, NAMES, ["l"]) == []


def test_a_size_that_its_age_does_not_explain_is_named(rng):
    ages = np.arange(12.0)
    sizes = 3.0 * 10 ** (ages / 9) * np.exp(0.03 * rng.standard_normal(12))
    assert size_contradictions({"age": ages}, NAMES, sizes) == []
    sizes[4] *= 2
    (note,) = size_contradictions({"age": ages, "noise": rng.random(12)}, NAMES, sizes)
    assert note.shapes == ("e",)
    assert note.values["times"][0] == pytest.approx(2.0, rel=0.15)
