"""What labels contradict of a result, and what they explain of it."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.output.label_notes import with_label_notes, without_label_notes
from data_tools.embedding.copies import Copies
from data_tools.notes import Note
from tests.notes import codes, only
from tests.view_problems import view_of

NUM = 12


def sized(factors):
    """A result of shapes of one form, in these sizes."""
    view = view_of(NUM)
    shape = np.nan_to_num(view.landmarks[0])
    return replace(view, notes=(), landmarks=np.stack([size * shape for size in factors]))


def test_every_contradiction_is_a_note_once():
    """They are the same after a second look, and gone where another table is used."""
    view = sized(np.ones(NUM))
    names = view.names
    strange = Note("resembles-none", names[:1], {"mismatch": 0.9, "median": 0.4})
    view = replace(view, notes=(strange,), copies=(Copies(names=names[3:5], kind="moved"),))
    assert view.reflected.sum() == 1
    labels = {
        "sex": ["female"] * 4 + ["male"] * 7 + ["femal"],
        "age": [*map(str, range(1, NUM)), "6O"],
        "side": ["left", "right", "left", *["right"] * 9],
    }
    found = with_label_notes(view, labels)
    assert codes(found.notes) == [
        "resembles-none",
        "labels-not-numbers",
        "labels-misspelt",
        "labels-of-sides",
        "labels-of-copies",
        "labels-of-strangers",
    ]
    assert only(found.notes, "labels-not-numbers").shapes == names[11:]
    assert only(found.notes, "labels-of-sides").shapes == names[:1]
    assert with_label_notes(found, labels).notes == found.notes
    assert without_label_notes(found).notes == view.notes
    assert with_label_notes(view, {}).notes == view.notes
    declared = with_label_notes(view, labels, numbers=["age"])
    assert "labels-not-numbers" not in codes(declared.notes)


@pytest.mark.parametrize(
    ("labels", "is_said"),
    [
        ({}, True),
        ({"sex": [*"fm"] * 6}, True),
        ({"stage": ["adult"] * 10 + ["young"] * 2}, True),  # the other young one is large
        ({"stage": ["young"] * 2 + ["adult"] * 9 + ["young"]}, False),
        ({"age": [*map(str, [5.2, 5, *np.linspace(10, 11, 9), 5.1])]}, False),
        ({"age": [*map(str, [8, 12, *np.linspace(9, 11, 9), 1])]}, False),  # the youngest of all
        ({"age": [*map(str, [8, 12, *np.linspace(9, 11, 9), 30])]}, True),
        ({"age": [*map(str, [8, 12, *np.linspace(9, 11, 9), ""])]}, True),
    ],
)
def test_sizes_that_labels_explain_are_not_named(labels, is_said, rng):
    small = np.array([0.5, 0.5, *np.linspace(0.98, 1.04, 9), 0.5])
    said = Note("size-apart", view_of(NUM).names[11:], {"times": (0.5,)})
    found = with_label_notes(replace(sized(small), notes=(said,)), labels)
    assert [note for note in found.notes if note.code == "size-apart"] == [said] * is_said
