"""Six small collections are aligned as they were; the comparison notices another result."""

from copy import deepcopy
from functools import reduce
from operator import getitem

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


@pytest.mark.parametrize(
    ("place", "name", "change"),
    [
        ((ALIGNMENT_FILE, "shapes", 2, "transform", 0), 1, lambda one: one + 2.0 * TOLERANCE),
        ((ALIGNMENT_FILE, "shapes", 1), "confidence", lambda one: one - 2.0 * TOLERANCE),
        ((ALIGNMENT_FILE, "shapes", 1), "confidence", lambda _: None),
        ((ALIGNMENT_FILE, "shapes", 3), "reflected", lambda _: True),
        ((ALIGNMENT_FILE,), "notes", lambda notes: [*notes, {"code": "doubtful"}]),
        ((), PAIRS_FILE, lambda pairs: pairs[:-1]),
        ((PAIRS_FILE, 0), "inlier", lambda _: 0.0),
        ((CORRESPONDENCES_FILE, "labels"), "values", lambda labels: labels[1::-1] + labels[2:]),
        ((), CORRESPONDENCES_FILE, lambda arrays: {"labels": arrays["labels"]}),
    ],
)
def test_another_result_is_noticed(place, name, change):
    stored = load_record("rigid").values
    found = deepcopy(stored)
    assert differences(stored, found) == []
    inner = reduce(getitem, place, found)
    inner[name] = change(inner[name])
    assert differences(stored, found) != []
    assert differences(found, stored) != []
