"""How sure a pose is: nearly tied rivals make doubt, more targets make certainty."""

import numpy as np
import pytest

from collalign.confidence.overlap_model import MOST_CERTAIN, certainty, rival_margin

FLIPPED = np.diag([1.0, -1.0, -1.0])


def test_a_tie_is_even_odds_and_no_rival_the_most_that_is_said():
    assert certainty(0.0, 8) == 0.5
    assert certainty(np.inf) == pytest.approx(1.0 / (1.0 + np.exp(-MOST_CERTAIN)))
    chances = [certainty(margin) for margin in (0.0, 0.1, 0.2, 0.4)]
    assert chances == sorted(chances)
    assert certainty(0.1, 8) > certainty(0.1, 2) > certainty(0.1, 1)


def test_the_margin_is_that_of_the_best_rival_on_the_mean_of_all_targets():
    near = np.array([[np.cos(0.1), -np.sin(0.1), 0], [np.sin(0.1), np.cos(0.1), 0], [0, 0, 1.0]])
    turns = np.stack([np.eye(3), near, FLIPPED, FLIPPED @ near])
    energies = np.exp([[0.0, 0.0], [0.01, 0.0], [0.3, 0.1], [0.5, 0.5]])
    assert rival_margin(turns, energies) == pytest.approx(0.2)
    assert rival_margin(turns[:2], energies[:2]) == np.inf
    assert rival_margin(np.stack([np.eye(3), -np.eye(3)]), energies[:2]) == pytest.approx(0.005)
