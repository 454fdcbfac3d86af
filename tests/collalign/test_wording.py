"""Every note has a text, and every text is used."""

import ast
import re

import pytest

from collalign.stages.mixed_sides import BY_FIT, MIXED
from collalign.wording import COLLECTION_TEXTS, SHAPE_TEXTS, TOOL_TEXTS, note_records, note_text
from data_tools.io.formats.raw_shape import NOT_KEPT
from data_tools.io.shapes import COARSE
from data_tools.notes import Note
from data_tools.surface.cleaning import COMPONENTS_KEPT, PLAIN_LEFT_OUT, SHARED_TAKEN
from data_tools.surface.hidden import WALLS, WALLS_LEFT_OUT
from tests.test_layers import sources

TEXTS = {**SHAPE_TEXTS, **COLLECTION_TEXTS, **TOOL_TEXTS}
PAIR = ("a", "b")
SIDES = {"num_better": 6, "num_pairs": 13}
REFLECTED = {"num_reflected": 2, "total": 6}
#: Of codes whose text depends on more than the fields of a template, notes that show every branch.
EXAMPLES = [
    Note("not-shapes", values={"num": 1, "files": ("notes.txt",)}),
    Note("not-shapes", values={"num": 9, "files": ("notes.txt", "truth.json")}),
    Note("components-kept", values={"kept": 1, "total": 2, "share": 99.0, "dropped": 8}),
    Note("components-kept", values={"kept": 2, "total": 2, "share": 100.0, "dropped": 0}),
    Note("all-incomplete", PAIR, {"reasons": ("named", "cut-off"), "coverages": (0.37, 0.0)}),
    Note("all-incomplete", PAIR, {"reasons": ("scan", "scan"), "coverages": (0.37, 0.5)}),
    Note("incomplete", PAIR, {"reasons": ("named", "cut-off"), "coverages": (0.37, 0.0)}),
    Note("incomplete", PAIR, {"reasons": ("cut-off", "cut-off"), "coverages": (0.37, 0.5)}),
    Note("coarse-coordinates", PAIR, {"steps": (0.5, 0.25)}),
    *(
        Note("copies", (*"abcdefghijkl",), {"kind": kind})
        for kind in ("identical", "moved", "mirrored")
    ),
    Note("copies", PAIR, {"kind": "identical"}),
    *(
        Note(
            "extra-material", PAIR, {"shares": (0.1, 0.3), "sides": ("z", "-x"), "ignored": ignored}
        )
        for ignored in (False, True)
    ),
    Note("few-for-sides", values={"most": 0.8}),
    Note("few-points", PAIR, {"num": 64, "counts": (18, 9)}),
    Note("sides-in-one-place", values={"most": 0.5}),
    Note("given", values={"num_invariants": 1, "weight": 0.4, "num_samples": 9}),
    Note("given", values={"num_ordered": 4}),
    Note(
        "given",
        values={"num_posed": 2, "num_near": 1, "near_deg": 20.0, "num_weights": 3, "num_zero": 1},
    ),
    Note(
        "components-kept",
        values={"kept": 1, "total": 2, "share": 40.0, "dropped": 8, "chosen": True},
    ),
    Note("shared-pieces", PAIR, {"shares": (0.8, 0.7)}),
    Note("plain-left-out", PAIR, {"shares": (0.8, 0.7)}),
    Note("walls-left-out", PAIR, {"shares": (0.4, 0.3)}),
    *(
        Note("sides-not-confirmed", PAIR, {"num_better": 3, "num_pairs": 9, "most": most})
        for most in (0.5, 1.0)
    ),
    Note("groups-of-one", PAIR, {"column": "x", "groups": ("f", "m")}),
    Note("mirror-part-fits-better", PAIR[:1], {"chance": 0.62}),
    Note("templates-doubtful", PAIR, {"counted": True}),
    Note("templates-doubtful", PAIR, {"counted": False}),
    Note("templates-disagree", PAIR, {"labels": ("LM3",), "distances": (4.5,)}),
    Note("templates-disagree", PAIR[:1], {"labels": ("LM3",), "distances": (4.5,)}),
    *(
        Note(
            "templates-reordered",
            shapes,
            {"kind": kind, "labels": ("LM3", "LM12"), "places": ("LM12", "LM3")},
        )
        for kind in ("swapped", "reversed", "shifted", "exchanged", "renamed")
        for shapes in (PAIR, PAIR[:1])
    ),
    Note("much-larger", PAIR, {"times": (1e3, 25.4)}),
    Note("much-smaller", PAIR, {"times": (1e3, 25.4)}),
    *(
        Note("not-reflected-unclear", PAIR, {**SIDES, "cause": cause})
        for cause in ("surfaces", "few-shapes")
    ),
    Note("not-reflected-unclear", PAIR, {**SIDES, "cause": "no-outer-side"}),
    Note("open-borders", PAIR),
    *(
        Note(
            "pairs-proven",
            values={
                "num_optimal": 2,
                "num_tried": 3,
                "num_wanted": 3 + more,
                "num_chirality": more,
                "num_improved": more,
                "num_complete": 2,
                "num_unique": 1,
                "within": 1.2,
            },
        )
        for more in (0, 2)
    ),
    Note("resembles-none", ("a",), {"mismatch": 0.95, "median": 0.68}),
    Note("resembles-none", PAIR, {"mismatch": 0.95, "median": 0.68}),
    Note(
        "symmetric",
        values={
            "num": 4,
            "total": 5,
            "rotations": "180 deg about (0.00, 0.00, 1.00)",
            "up_to": 0.9,
            "absolute": 0.4,
        },
    ),
    Note("vertex-maps-doubtful", PAIR, {"confidences": (0.31, 0.4)}),
    Note("arrangement-refuted", PAIR, {"saving": 0.02, "doubtful": ()}),
    Note("arrangement-refuted", PAIR, {"saving": 0.02, "doubtful": ("a",)}),
    Note("landmarks-off-surface", ("a",), {"labels": PAIR, "distances": (0.5, 2.0)}),
    Note("left-out-of-statistics", PAIR, {"reasons": ("incomplete", "doubtful")}),
    Note("size-apart", PAIR, {"times": (2.03, 0.6)}),
    Note("labels-misspelt", PAIR, {"column": "x", "groups": PAIR, "similar": ("aa", "bb")}),
    Note("labels-not-numbers", PAIR, {"column": "x", "cells": ("6O", "12 a")}),
    Note("labels-of-copies", PAIR, {"column": "x", "labels": ("f", "m")}),
    Note("labels-of-sides", PAIR, {"column": "x", "labels": PAIR, "num_agree": 23, "total": 25}),
    Note("labels-of-size", PAIR, {"column": "x", "times": (2.0, 0.1)}),
    Note("labels-taken-as", PAIR, {"source": "x", "rows": ("1", "2")}),
    Note(
        "labels-unknown", values={"source": "x", "rows": PAIR, "hints": ("", "did you mean 'b'?")}
    ),
    Note(
        "left-out-differ",
        values={
            "column": "age",
            "num": 5,
            "total": 10,
            "range": (0.0, 27.0),
            "range_counted": (3.0, 15.0),
            "p": 0.04,
        },
    ),
    Note("left-out-doubtful", PAIR, {"num": 10, "counted": 8, "chance": 0.9}),
    Note(
        "groups-left-out",
        values={"column": "age", "groups": PAIR, "counted": (0, 1), "totals": (3, 4)},
    ),
    Note("kind-alone", ("a",)),
    Note("kind-alone", PAIR),
    Note("kind-of", PAIR, {"of_kind": "kind 2", "of_code": "copies", "kind": "identical"}),
    Note("kinds-found", values={"num": 2, "groups": ("kind 1 (a, b)", "c"), "confidence": 0.9}),
    Note("kinds-given", values={"num": 2, "groups": ("chairs (a, b)", "mugs (c)")}),
    Note("kinds-apart", values={"kinds": ("mugs", "vases"), "named": ("up",)}),
    Note("kinds-posed", values={"kinds": ("mugs",), "shares": (0.7,)}),
    Note("size-not-tested", PAIR, {"times": (1e3, 25.4)}),
]


def fields(template):
    """Return values for the fields of a template, by how it formats them."""
    found = re.findall(r"\{(\w+)(?::([^}]*))?\}", template)
    return {
        name: 0.5 if spec else "x" for name, spec in found if name not in ("shapes", "num_shapes")
    }


def every_note():
    plain = [
        Note(code, PAIR, fields(text)) for code, text in TEXTS.items() if isinstance(text, str)
    ]
    return [*plain, *EXAMPLES]


def codes_in(source):
    """Return the codes of notes that a module makes, and the beginnings of those that it composes."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Note":
            for part in ast.walk(node.args[0]):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    found.add(part.value)
    return found


@pytest.mark.parametrize("note", every_note(), ids=lambda note: note.code)
def test_a_note_is_worded(note):
    text = note_text(note)
    assert text != str(note)
    assert not re.search(r"[{}]|  ", text), "a field without a value"
    if note.code not in SHAPE_TEXTS:
        assert text[0].isupper() or text[0] in "abx24"
        assert text[-1] in ".x"


def test_notes_that_are_made_have_a_text_and_texts_have_notes():
    made = set().union(*(codes_in(file.read_text("utf-8")) for package, file in sources()))
    composed = {
        code
        for code in TEXTS
        if code.startswith(("arrangement-", "coordinates-", "landmarks-", "much-"))
    }
    named = {COARSE, COMPONENTS_KEPT, NOT_KEPT, PLAIN_LEFT_OUT, SHARED_TAKEN, WALLS, WALLS_LEFT_OUT}
    assert TEXTS.keys() - made - composed == named | {MIXED, BY_FIT}
    assert {code for code in made if re.fullmatch(r"[a-z]+(-[a-z]+)+", code)} <= TEXTS.keys()


def test_codes_are_found_in_source():
    assert codes_in('Note("a-b" if x else "c-d", (name,), {"num": 3})\nother("e-f")') == {
        "a-b",
        "c-d",
    }


def test_a_note_of_another_version_or_damaged_shows_its_fields():
    assert note_text(Note("new-in-2", ("a",), {"num": 3})) == "new-in-2: a, num=3"
    assert note_text(Note("copies", ("a",))) == "copies: a"
    assert note_text(Note("fewer-points", values={"num": 3})) == "fewer-points: num=3"


def test_records_have_code_fields_and_text():
    (found,) = note_records([Note("doubtful", PAIR)])
    assert found["code"] == "doubtful"
    assert found["shapes"] == ["a", "b"]
    assert found["text"].startswith("In doubt: a, b.")


def test_names_that_look_like_fields_stay_names():
    assert "{num}" in note_text(Note("doubtful", ("{num}",)))


def test_a_note_of_a_part_names_it_first():
    assert (
        note_text(Note("duplicates-merged", ("jaw",), {"num": 3}))
        == "jaw: merged 3 duplicate vertices"
    )


@pytest.mark.parametrize("kind", ["raw", "raw-sides", "unscaled", "aligned", "procrustes"])
def test_all_coordinates_have_a_text(kind):
    assert note_text(Note(f"coordinates-{kind}", values=REFLECTED)).startswith("Coordinates: ")


def test_the_command_that_counts_one_of_many_copies_can_be_given_as_it_is():
    few, many = (
        note_text(Note("copies", (*names,), {"kind": "identical"}))
        for names in ("ab", "abcdefghijkl")
    )
    assert few.endswith("add --exclude b.")
    assert many.endswith("leave the others out (--exclude).")
