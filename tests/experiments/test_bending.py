"""What the best poses could come to: nothing where the truth is consistent, something where it is not."""

from pathlib import Path

import numpy as np

from data_tools.rotations import random_rotation
from experiments.collections.bending import best_possible
from experiments.collections.posed import PosedCollection


def truth(num):
    rng = np.random.default_rng(0)
    turns = np.stack([random_rotation(rng) for _ in range(num)])
    relative = turns[:, None] @ np.swapaxes(turns, 1, 2)[None]
    return PosedCollection(folder=Path(), names=tuple("abcdefgh"[:num]), relative=relative)


def test_a_contradictory_truth_cannot():
    posed = truth(6)
    posed.relative[0, 1] = posed.relative[0, 1] @ np.diag([1.0, -1.0, -1.0])
    posed.relative[1, 0] = posed.relative[0, 1].T
    errors = posed.pair_errors_deg(best_possible(posed), posed.names)
    assert errors[0] > 90.0
    assert np.median(errors) < 1e-3
