"""Kinds that are mixed: what counts as pure, split and alone, and a library that grows."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from collalign.engine.store import Store
from data_tools.rotations import random_rotation
from experiments.collections import kinds, library
from experiments.collections.kinds import DrawnKinds, judge, num_alone, num_split, purity, row_of
from experiments.collections.posed import PosedCollection
from experiments.experiment import Bench

TRUE = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1])


@pytest.mark.parametrize(
    ("found", "share", "split", "alone"),
    [
        ([5, 5, 5, 5, 5, 5, 2, 2, 2], 1.0, 0, 0),
        ([0] * 9, 6 / 9, 0, 0),
        ([0, 0, 0, 1, 1, 1, 2, 2, 2], 1.0, 1, 0),
        ([0, 0, 0, 0, 0, 1, 2, 2, 2], 1.0, 0, 1),
        ([0, 0, 0, 0, 0, 2, 2, 2, 2], 8 / 9, 0, 0),
        ([0, 0, 0, 0, 0, 0, 2, 2, -1], 8 / 9, 0, 0),
    ],
)
def test_merged_kinds_are_impure_and_parts_of_one_are_split(found, share, split, alone):
    found = np.array(found)
    assert purity(TRUE, found) == pytest.approx(share)
    assert (num_split(TRUE, found), num_alone(found)) == (split, alone)


@pytest.fixture
def drawn():
    """Three shapes each of two kinds in known random poses."""
    rng = np.random.default_rng(1)
    turns = {kind: np.stack([random_rotation(rng) for _ in range(3)]) for kind in "ab"}
    posed = {
        kind: PosedCollection(
            folder=Path(),
            names=tuple(f"{kind}/{i}" for i in range(3)),
            relative=own[:, None] @ np.swapaxes(own, 1, 2)[None],
        )
        for kind, own in turns.items()
    }
    return DrawnKinds(kinds=posed), np.concatenate([*turns.values()])


def answer(drawn, turns, labels):
    """The right poses, in some found kinds."""
    labels = np.array(labels)
    return SimpleNamespace(
        names=drawn.names,
        rotations=np.swapaxes(turns, 1, 2),
        part_numbers=labels,
        confidence=np.full(6, 0.96),
        kinds=[SimpleNamespace(shapes=np.flatnonzero(labels == k)) for k in np.unique(labels)],
    )


def test_right_poses_are_right_kind_by_kind_and_a_pair_in_two_kinds_is_gross(drawn):
    right = judge(answer(*drawn, [0, 0, 0, 1, 1, 1]), drawn[0]) | {"processor_s": 1.0}
    row = row_of("both", [right])
    figures = ("kinds", "found", "purity", "gross", "sure", "wrong_sure")
    assert [row[key] for key in figures] == [2, 2, 100.0, 0.0, 6, 0]
    mixed = judge(answer(*drawn, [0, 0, 1, 1, 1, 1]), drawn[0]) | {"processor_s": 1.0}
    row = row_of("both", [mixed])
    assert row["purity"] == pytest.approx(500 / 6)
    assert row["gross"] == pytest.approx(200 / 6)
    turned = drawn[1].copy()
    turned[0] = np.diag([1.0, -1.0, -1.0]) @ turned[0]
    wrong = judge(answer(drawn[0], turned, [0, 0, 0, 1, 1, 1]), drawn[0]) | {"processor_s": 1.0}
    assert row_of("both", [wrong])["wrong_sure"] == 1


def test_poses_are_compared_pair_by_pair_whatever_their_frames():
    rng = np.random.default_rng(2)
    rotations = np.stack([random_rotation(rng) for _ in range(4)])
    frame = random_rotation(rng)
    once = {"names": [*"abcd"], "rotations": rotations, "parts": np.zeros(4, dtype=int)}
    order = [2, 0, 3, 1]
    grown = {
        "names": [once["names"][i] for i in order],
        "rotations": (frame @ rotations)[order],
        "parts": np.zeros(4, dtype=int),
    }
    of_kind = np.array([0, 0, 1, 1])
    assert library.share_as_at_once(once, grown, of_kind) == 1.0
    grown["rotations"][0] = random_rotation(rng)
    assert library.share_as_at_once(once, grown, of_kind) == 0.5
    assert library.angles_between(rotations, frame @ rotations).max() < 1e-4


def test_a_library_has_every_shape_in_one_step(tmp_path):
    of_each, rotations = library.write_library(tmp_path, library.NUM_QUICK, 0)
    files = sorted(tmp_path.glob("step*/*.ply"))
    assert sorted(file.stem for file in files) == sorted(of_each) == sorted(rotations)
    assert np.bincount([*of_each.values()]).tolist() == [2] * len(library.KINDS)


@pytest.mark.data
@pytest.mark.usefixtures("quick_search")
def test_a_quick_run_fills_both_tables(shared_data, tmp_path):
    bench = Bench(data=shared_data, store=Store.memory(), quick=True, quiet=True, results=tmp_path)
    mixed, single = kinds.measure(bench).tables
    assert mixed.rows[0]["shapes"] == 10
    assert mixed.rows[0]["purity"] >= 90.0
    assert single.rows[0]["found"] == 1
