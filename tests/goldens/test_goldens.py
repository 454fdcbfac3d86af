"""Six small collections are aligned as they were; the comparison notices another result, and only that."""

import json
import shutil
from copy import deepcopy

import numpy as np
import pytest

from collalign.output.evidence_file import CORRESPONDENCES_FILE
from collalign.output.write import ALIGNMENT_FILE, PAIRS_FILE
from tests.commands import read_json
from tests.goldens.inputs import GOLDENS
from tests.goldens.record import (
    TOLERANCE,
    Record,
    aligned_record,
    changed_files,
    differences,
    load_record,
    record_of,
    store_record,
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


def test_version_options_and_times_are_no_part_of_the_result(rigid, tmp_path):
    record, folder = rigid
    out = shutil.copytree(folder / "out", tmp_path / "out")
    alignment = read_json(out / ALIGNMENT_FILE)
    alignment["version"], alignment["options"] = "9.9", {}
    (out / ALIGNMENT_FILE).write_text(json.dumps(alignment))
    with np.load(out / CORRESPONDENCES_FILE) as arrays:
        np.savez(out / CORRESPONDENCES_FILE, **arrays)  # not compressed: other bytes
    (out / "run.json").unlink()
    assert changed_files(record, record_of(folder / "shapes", out)) == []


def test_a_last_bit_changes_a_hash_and_no_value(rigid, tmp_path):
    record, folder = rigid
    out = shutil.copytree(folder / "out", tmp_path / "out")
    alignment = read_json(out / ALIGNMENT_FILE)
    row = alignment["shapes"][1]["transform"][0]
    row[0] = float(np.nextafter(row[0], 2.0))
    (out / ALIGNMENT_FILE).write_text(json.dumps(alignment))
    with np.load(out / CORRESPONDENCES_FILE) as arrays:
        moved = {**arrays, "labels": np.roll(arrays["labels"], 1)}
    np.savez(out / CORRESPONDENCES_FILE, **moved)
    found = record_of(folder / "shapes", out)
    assert changed_files(record, found) == [ALIGNMENT_FILE, CORRESPONDENCES_FILE]
    lines = differences(record.values, found.values)
    assert lines
    assert all(line.startswith(f"/{CORRESPONDENCES_FILE}/labels") for line in lines)


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


def test_what_is_not_finite_is_stored_and_equals_itself_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.goldens.record.STORED", tmp_path / "stored")
    store_record(
        "odd", Record({}, {"nan": float("nan"), "bound": float("-inf"), "third": 1.0 / 3.0})
    )
    values = load_record("odd").values
    assert values["third"] == pytest.approx(1.0 / 3.0, abs=1e-5)
    assert differences(values, values) == []
    assert len(differences(values, {"nan": 0.0, "bound": float("inf"), "third": float("nan")})) == 3
