"""A part of :mod:`tests.bad_inputs` with every run of the tests; all 300 by ``python -m tests.bad_inputs``."""

import dataclasses

import pytest

from collalign import RunOptions, align_collection
from tests.bad_inputs import NUM_GOOD, OPTIONS, unaccounted, write_bad_inputs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("bad") / "shapes"
    assert write_bad_inputs(path, every=6) > 50
    return path


@pytest.fixture(scope="module")
def collection(folder):
    return align_collection(folder, options=OPTIONS, run=RunOptions(memory_limit_gib=4.0))


def test_every_bad_input_is_named_or_aligned(folder, collection, tmp_path):
    assert not unaccounted(folder, collection)
    assert {f"good{i}" for i in range(NUM_GOOD)} <= set(collection.names)
    assert len(collection.excluded) > 40
    assert all(len(item.reason) > 10 and "Traceback" not in item.reason for item in collection.excluded)
    assert not [item for item in collection.excluded if "time limit" in item.reason or "died" in item.reason]
    collection.save(tmp_path / "out")


def test_there_are_three_hundred(tmp_path):
    assert write_bad_inputs(tmp_path / "all") >= 300


def test_an_input_that_is_passed_over_is_noticed(folder, collection):
    forgotten = collection.excluded[7].file
    short = dataclasses.replace(collection, excluded=tuple(e for e in collection.excluded if e.file != forgotten))
    assert len(unaccounted(folder, short)) == 1
