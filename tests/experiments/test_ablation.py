"""The ablation: switches find their mechanisms, what they leave is computed once, rows count what moves."""

import time

import numpy as np
import pytest

from data_tools.io.shapes import read_shape
from data_tools.rotations import rotation_angle_deg
from experiments.collections import switches
from experiments.collections.ablation import CAPOD, SETS, moves, posed_set, row_of
from experiments.collections.landmarked import COLLECTIONS
from experiments.collections.switches import PURE, SWITCHES, Remembered, Switch, switched_off
from experiments.confidence.families import FAMILIES


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_finds_its_mechanism_and_puts_it_back(name):
    with switched_off(SWITCHES[name]):
        pass
    with switched_off(SWITCHES[name]):  # as before: nothing was left switched off
        pass


CALLS = []


def measured(values, *, scale=1.0):
    CALLS.append(scale)
    end_s = time.process_time() + 0.01
    while time.process_time() < end_s:
        pass
    return values.sum() * scale


def test_what_no_switch_reaches_is_computed_once(monkeypatch):
    monkeypatch.setattr(switches, "PURE", (f"{__name__}.measured",))
    remembered, ones = Remembered(), np.ones(3)
    before = measured
    with remembered.used():
        assert [
            measured(ones),
            measured(ones + 1),
            measured(np.ones(3)),
            measured(ones, scale=2.0),
        ] == [3, 6, 3, 6]
        assert CALLS == [1.0, 1.0, 2.0]
        assert remembered.saved_s >= 0.01
        with switched_off(Switch(patches={f"{__name__}.measured": lambda values: 0})):
            assert measured(ones) == 0
    assert measured is before


def test_all_that_is_remembered_is_there():
    with Remembered().used():
        assert len(PURE) == len({*PURE})


def test_every_collection_has_a_source():
    known = {*COLLECTIONS, *CAPOD, *FAMILIES, "long bones"}
    assert {given["source"] for given in SETS.values()} <= known


def record(pairs, shapes, confidence, **more):
    return {
        "pairs": np.array(pairs),
        "shapes": np.array(shapes),
        "confidence": np.array(confidence),
        **more,
    }


def test_a_row_counts_runs_that_were_not_switched_as_they_are():
    complete = record([2.0, 4.0, 90.0], [1.0, 2.0, 90.0], [0.99, 0.92, 0.5])
    worse = record([2.0, 80.0, 90.0], [1.0, 80.0, 90.0], [0.99, 0.96, 0.5], saved_s=1.5)
    records = [{"": complete, "own turns": worse}, {"": complete}]
    row = row_of("own turns", records)
    assert (row["runs"], row["differ"], row["wrong"], row["wrong_sure"]) == (1, 1, 3, 1)
    assert (row["sure"], row["right"], row["usable"], row["saved"]) == (3, 3, 3, 1.5)
    assert row["gross"] == pytest.approx(50.0)
    assert row_of("", records)["wrong"] == 2
    assert moves(worse, complete)
    assert not moves(complete, complete)


def test_copies_come_in_poses_that_are_known(tmp_path):
    settings = {"source": "chairs", "shapes": 2, "copies": 2, "seed": 0}
    posed = posed_set(settings, tmp_path, tmp_path)
    assert posed.names[2:] == ("copy0", "copy1")
    first, copy = (
        read_shape(tmp_path / f"{name}.ply").vertices for name in (posed.names[0], "copy1")
    )
    np.testing.assert_allclose(copy @ posed.relative[0, 3].T, first, atol=1e-4)
    loop = posed.relative[2, 1] @ posed.relative[1, 3] @ posed.relative[3, 2]
    assert rotation_angle_deg(loop, np.eye(3)) < 0.1
