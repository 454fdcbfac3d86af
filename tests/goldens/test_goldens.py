"""Six small collections are aligned as they were; the comparison notices another result."""

from copy import deepcopy

import numpy as np
import pytest

from collalign.output.evidence_file import CORRESPONDENCES_FILE
from collalign.output.write import ALIGNMENT_FILE, PAIRS_FILE
from tests.goldens.inputs import GOLDENS
from tests.goldens.record import (
    TOLERANCE,
    aligned_record,
    differences,
    load_record,
)


@pytest.fixture(scope="module")
def rigid(tmp_path_factory):
    """The record of the first collection, and the folder with its shapes and its result."""
    folder = tmp_path_factory.mktemp("rigid")
    return aligned_record(GOLDENS["rigid"](), folder), folder


@pytest.mark.parametrize("name", GOLDENS)
def test_a_collection_is_aligned_as_it_was(name, tmp_path, rigid):
    found = rigid[0] if name == "rigid" else aligned_record(GOLDENS[name](), tmp_path)
    assert differences(load_record(name).values, found.values) == []


def test_the_collections_show_what_they_were_made_for():
    alignments = {name: load_record(name).values[ALIGNMENT_FILE] for name in GOLDENS}
    assert [shape["name"] for shape in alignments["sides"]["shapes"] if shape["reflected"]] == [
        "crown2",
        "crown5",
    ]
    assert [one["name"] for one in alignments["fragment"]["incomplete"]] == ["blob4"]
    assert alignments["bodies"]["decided"]["maps"]
    assert [{name[:4] for name in group} for group in alignments["kinds"]["groups"]] == [
        {"blob"},
        {"figu"},
    ]
    assert not any(
        shape["reflected"] for name in ("rigid", "clouds") for shape in alignments[name]["shapes"]
    )


def turn_shape(values):
    angle = np.radians(3.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    transform = np.array(values[ALIGNMENT_FILE]["shapes"][2]["transform"])
    transform[:2] = turn @ transform[:2]
    values[ALIGNMENT_FILE]["shapes"][2]["transform"] = transform.tolist()


def lower_confidence(values):
    values[ALIGNMENT_FILE]["shapes"][1]["confidence"] -= 2.0 * TOLERANCE


def forget_confidence(values):
    values[ALIGNMENT_FILE]["shapes"][1]["confidence"] = None


def mirror(values):
    values[ALIGNMENT_FILE]["shapes"][3]["reflected"] = True


def add_note(values):
    values[ALIGNMENT_FILE]["notes"].append(
        {"code": "doubtful", "shapes": [], "values": {}, "text": "One more."}
    )


def drop_pair(values):
    values[PAIRS_FILE].pop()


def reject_pair(values):
    values[PAIRS_FILE][0]["inlier"] = 0.0


def relabel(values):
    labels = values[CORRESPONDENCES_FILE]["labels"]["values"]
    labels[:2] = labels[1::-1]


def lose_array(values):
    del values[CORRESPONDENCES_FILE]["consensus"]


WRONG = (turn_shape, lower_confidence, forget_confidence, mirror, add_note)
WRONG += (drop_pair, reject_pair, relabel, lose_array)


@pytest.mark.parametrize("change", WRONG, ids=lambda change: change.__name__)
def test_another_result_is_noticed(change):
    stored = load_record("rigid").values
    found = deepcopy(stored)
    assert differences(stored, found) == []
    change(found)
    assert differences(stored, found) != []
    assert differences(found, stored) != []
