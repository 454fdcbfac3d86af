"""Poses by landmarks, vertices and mirror pairs of landmarks."""

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.rotations import random_rotation
from experiments.ground_truth import landmark_rotation, read_symmetry


def test_landmarks_give_back_the_planted_rotation(rng):
    source = rng.standard_normal((8, 3))
    for group in ("SO", "O"):
        truth = random_rotation(rng, group=group)
        target = 3.0 * source @ truth.T + [1, 2, 3]
        target[2] = np.nan
        np.testing.assert_allclose(
            landmark_rotation(target, source, group=group), truth, atol=1e-12
        )


def test_symmetry_is_an_involution(tmp_path):
    path = tmp_path / "a.sym.info"
    path.write_text("0 3\n1 2 \n\n4\n")
    partner = read_symmetry(path, num_landmarks=6)
    assert partner.tolist() == [3, 2, 1, 0, 4, 5]
    for content in ("0 6\n", "0 1 2\n", "a b\n", "0 1\n1 2\n"):
        path.write_text(content)
        with pytest.raises(InputError, match="line"):
            read_symmetry(path, num_landmarks=6)
