import dataclasses

import numpy as np
import pytest

from collalign.engine.records import from_arrays, to_arrays
from collalign.output.collection import Collection
from collalign.output.evidence_file import EVIDENCE_FILE, label_maps
from collalign.output.loading import load
from data_tools.errors import InputError
from tests.view_problems import NUM_SAMPLES, view_of, write_result


def test_a_view_comes_back_as_it_was(tmp_path):
    view = view_of(7, num_missing=3)
    write_result(view, tmp_path)
    found = load(tmp_path)
    for field in dataclasses.fields(Collection):
        before, after = getattr(view, field.name), getattr(found, field.name)
        if field.name in ("pairs", "alternatives", "vertices", "faces", "maps", "folder"):
            continue
        if isinstance(before, np.ndarray):
            np.testing.assert_array_equal(after, before)
        else:
            assert after == before, field.name
    np.testing.assert_array_equal(view.maps.labels, found.maps.labels)
    for name in ("vertices", "faces"):
        for a, b in zip(getattr(view, name), getattr(found, name), strict=True):
            np.testing.assert_array_equal(a, b)
    for a, b in zip(view.pairs, found.pairs, strict=True):
        assert (a.target, a.source, a.inlier, a.choice) == (b.target, b.source, b.inlier, b.choice)
        assert (a.status, a.chirality_proven) == (b.status, b.chirality_proven)
        np.testing.assert_array_equal([a.energy, a.lower_bound], [b.energy, b.lower_bound])
        for name in ("rotations", "energies"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    before, after = (label_maps(one.pairs, one.maps.labels) for one in (view, found))
    np.testing.assert_array_equal(before, after)
    assert [[pose.log_odds for pose in poses] for poses in found.alternatives][1] == [0.7]


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 cut short"])
def test_damaged_files_are_refused(tmp_path, content):
    (tmp_path / EVIDENCE_FILE).write_bytes(content)
    with pytest.raises(InputError, match="collalign align"):
        load(tmp_path)


def test_a_folder_without_result_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load(tmp_path)


def test_another_version_is_refused(tmp_path):
    np.savez(tmp_path / EVIDENCE_FILE, version=np.array(99))
    with pytest.raises(InputError, match="format 99"):
        load(tmp_path)


def test_views_check_themselves(tmp_path):
    view = view_of(3)
    for change in (
        {"names": ("a", "a", "b")},
        {"files": ("a",)},
        {"labels": {"taxon": ("a",)}},
        {"transforms": np.zeros((3, 3, 3))},
        {"alternatives": ((),)},
    ):
        with pytest.raises(InputError):
            load(write_result(dataclasses.replace(view, **change), tmp_path).parent)
    with pytest.raises(InputError, match="no shape is called"):
        view.index("nobody")


def first_pair(change):
    return lambda pairs: [pairs[0] | change(pairs[0]), *pairs[1:]]


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("transforms", lambda array: array * np.nan),
        ("transforms", lambda array: array * 0),
        ("transforms", lambda array: array * (np.arange(len(array)) > 0)[:, None, None]),
        ("faces", lambda parts: [part + 10**6 for part in parts]),
        ("vertices", lambda parts: [part * np.inf for part in parts]),
        ("vertices", lambda parts: parts[1:]),
        ("pairs", first_pair(lambda pair: {"rotations": 2 * pair["rotations"]})),
        ("pairs", first_pair(lambda pair: {"rotations": pair["rotations"][:, :2, :2]})),
        ("pairs", first_pair(lambda pair: {"target": 10**6})),
        ("pairs", first_pair(lambda pair: {"target": pair["source"]})),
        ("pairs", first_pair(lambda pair: {"choice": 2})),
        (
            "pairs",
            first_pair(lambda pair: {"map_target_source": pair["map_target_source"] + NUM_SAMPLES}),
        ),
        ("part_numbers", lambda array: array + 0.5),
        ("landmarks", lambda array: array[:-1]),
        ("options", lambda options: options | {"group": "SU"}),
    ],
)
def test_impossible_numbers_are_refused(tmp_path, name, damage):
    path = write_result(view_of(5), tmp_path)
    with np.load(path) as file:
        arrays = dict(file)
    value = from_arrays({name: arrays[name]})[name]
    with np.errstate(invalid="ignore"):
        np.savez(path, **arrays | to_arrays({name: damage(value)}))
    with pytest.raises(InputError, match=r"evidence\.npz: damaged"):
        load(tmp_path)
