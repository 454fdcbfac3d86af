"""Poses by landmarks, vertices and mirror pairs of landmarks."""

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.rotations import random_rotation
from experiments.ground_truth import landmark_rotation, read_symmetry, read_vertex_indices


def test_landmarks_give_back_the_planted_rotation(rng):
    source = rng.standard_normal((8, 3))
    for group in ("SO", "O"):
        truth = random_rotation(rng, group=group)
        target = 3.0 * source @ truth.T + [1, 2, 3]
        target[2] = np.nan
        np.testing.assert_allclose(
            landmark_rotation(target, source, group=group), truth, atol=1e-12
        )


def test_mirrored_landmarks_differ_by_group(rng):
    source = rng.standard_normal((8, 3))
    target = source * [-1, 1, 1]
    assert np.linalg.det(landmark_rotation(target, source)) == pytest.approx(1)
    np.testing.assert_allclose(
        landmark_rotation(target, source, group="O"), np.diag([-1.0, 1, 1]), atol=1e-12
    )


def test_vertex_indices(tmp_path):
    path = tmp_path / "a.pid"
    path.write_text(" 7 0 0 0\n3 0 0 0\n\n")
    assert read_vertex_indices(path, num_vertices=8).tolist() == [7, 3]


def test_symmetry_is_an_involution(tmp_path):
    path = tmp_path / "a.sym.info"
    path.write_text("0 3\n1 2 \n\n4\n")
    partner = read_symmetry(path, num_landmarks=6)
    assert partner.tolist() == [3, 2, 1, 0, 4, 5]
    for content in ("0 6\n", "0 1 2\n", "a b\n", "0 1\n1 2\n"):
        path.write_text(content)
        with pytest.raises(InputError, match="line"):
            read_symmetry(path, num_landmarks=6)
