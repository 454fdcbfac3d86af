"""The ablation: switches find their mechanisms, and what they leave is computed once."""

import time

import numpy as np
import pytest

from experiments.collections import switches
from experiments.collections.switches import SWITCHES, Remembered, Switch, switched_off


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


def record(pairs, shapes, confidence, **more):
    return {
        "pairs": np.array(pairs),
        "shapes": np.array(shapes),
        "confidence": np.array(confidence),
        **more,
    }
