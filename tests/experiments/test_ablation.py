"""The ablation: switches find their mechanisms, and what they leave is computed once."""

import numpy as np
import pytest

from experiments.collections.ablation import moves, row_of
from experiments.collections.switches import SWITCHES, switched_off


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_finds_its_mechanism_and_puts_it_back(name):
    with switched_off(SWITCHES[name]):
        pass
    with switched_off(SWITCHES[name]):  # as before: nothing was left switched off
        pass


def test_a_row_counts_what_a_switch_moves_and_takes_the_complete_run_elsewhere():
    def facts(error, **others):
        return {
            "pair_deg": np.array([1.0, error]),
            "shape_deg": np.array([1.0, error]),
            "stated": np.array([0.97, 0.99]),
            **others,
        }

    first, second = {"": facts(50.0), "maps": facts(2.0, saved_s=3.0)}, {"": facts(50.0)}
    row = row_of("maps", [first, second])
    assert (row["runs"], row["differ"], row["wrong"], row["gross"]) == (1, 1, 1, 25.0)
    assert (row["wrong_sure"], row["saved"]) == (1, 3.0)
    assert row_of("", [first, second])["wrong"] == 2
    assert moves(first["maps"], first[""])
    assert not moves(facts(2.0), facts(3.0))
