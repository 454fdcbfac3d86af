"""The ablation: switches find their mechanisms, and what they leave is computed once."""

import pytest

from experiments.collections.switches import SWITCHES, switched_off


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_finds_its_mechanism_and_puts_it_back(name):
    with switched_off(SWITCHES[name]):
        pass
    with switched_off(SWITCHES[name]):  # as before: nothing was left switched off
        pass
