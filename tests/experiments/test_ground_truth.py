"""Poses by landmarks, vertices and mirror pairs of landmarks."""

import numpy as np

from data_tools.rotations import random_rotation
from experiments.ground_truth import landmark_rotation


def test_landmarks_give_back_the_planted_rotation(rng):
    source = rng.standard_normal((8, 3))
    for group in ("SO", "O"):
        truth = random_rotation(rng, group=group)
        target = 3.0 * source @ truth.T + [1, 2, 3]
        target[2] = np.nan
        np.testing.assert_allclose(
            landmark_rotation(target, source, group=group), truth, atol=1e-12
        )
