"""Tables and picture of what templates disagree on."""

import json

import numpy as np
import pytest

from collalign.tools.transfer.disagreement import (
    agreement_rows,
    agreement_text,
    findings,
)
from data_tools.notes import Note
from tests.view_problems import transferred_of, view_of

LABELS = ("LM1", "LM2", "$LM3", "surface-1")
SWAPPED = Note(
    "templates-reordered",
    ("s1",),
    {"kind": "swapped", "labels": ("LM1", "LM2"), "places": ("LM2", "LM1")},
)
FAR = Note("templates-disagree", ("s0", "s1"), {"labels": ("$LM3",), "distances": (0.4,)})


@pytest.fixture
def view():
    return view_of(3)


def transferred(view, *notes):
    trust = np.array([[1.0, 1.0, 1.0, 0.0]] * 3)
    errors = np.array([[0.1, 0.1, np.nan, np.nan]] * 3)
    codes = Note("landmark-codes", ("s0",), {"labels": ("LM1",)})
    return transferred_of(
        view, LABELS, template_trust=trust, left_out_errors=errors, notes=(codes, *notes)
    )


def named(view, note):
    return Note(note.code, tuple(view.names[int(name[1])] for name in note.shapes), note.values)


def test_findings_name_templates_and_landmarks(view):
    notes = [named(view, one) for one in (SWAPPED, FAR)]
    a, b = view.names[:2]
    found = list(findings(transferred(view, *notes)))
    assert found == [
        (b, "LM1", "swapped?"),
        (b, "LM2", "swapped?"),
        (a, "$LM3", "far"),
        (b, "$LM3", "far"),
    ]
    assert not list(findings(transferred(view)))


def test_the_table_has_every_template_and_landmark_but_no_points_of_the_surface(view):
    heading, *rows = agreement_rows(transferred(view, named(view, SWAPPED)))
    assert heading == ["template", "landmark", "distance", "trust", "finding"]
    assert [row[1] for row in rows] == ["LM1", "LM2", "$LM3"] * 3
    assert [row[4] for row in rows].count("swapped?") == 2
    record = json.loads(agreement_text(transferred(view, named(view, SWAPPED))))
    assert record["landmarks"] == ["LM1", "LM2", "$LM3"]
    assert record["distance"][0] == [0.1, 0.1, None]
    assert [one["code"] for one in record["notes"]] == ["templates-reordered"]
