import json

import pytest

from data_tools.errors import InputError
from data_tools.notes import Note, listed

FULL = Note("odd", ("a", "b"), {"times": (2.0, 3.5), "num": 4, "why": "size"})


def test_a_note_survives_json():
    assert Note.from_record(json.loads(json.dumps(FULL.record() | {"text": "words"}))) == FULL
    assert Note.from_record(Note("plain").record()) == Note("plain")


def test_a_note_can_be_told_from_others_of_its_code():
    assert {FULL: 1}[Note("odd", ("a", "b"), {**FULL.values})] == 1
    assert Note("odd", ("a", "b"), {**FULL.values, "num": 5}) != FULL


def test_a_note_prints_its_code_and_fields():
    assert str(FULL) == "odd: a, b, times=(2.0, 3.5), num=4, why=size"
    assert str(Note("plain")) == "plain"


@pytest.mark.parametrize(
    "change",
    [
        {"code": 3},
        {"code": None},
        {"shapes": "a"},
        {"shapes": [1]},
        {"shapes": None},
        {"values": []},
        {"values": {"num": None}},
        {"values": {"num": [[1]]}},
        {"values": {"num": {"a": 1}}},
    ],
)
def test_damaged_records_are_refused(change):
    with pytest.raises(InputError, match="note"):
        Note.from_record(FULL.record() | change)
    with pytest.raises(InputError, match="expected a code"):
        Note.from_record("odd")


def test_long_lists_are_cut():
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(i) for i in range(11)]) == "0, 1, 2, 3, 4, 5, 6, 7 and 3 more"
