import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.analysis.warp import thin_plate_warp
from data_tools.errors import InputError


def test_landmarks_arrive_where_they_should(rng: np.random.Generator) -> None:
    source, target = rng.standard_normal((2, 12, 3))
    np.testing.assert_allclose(thin_plate_warp(source, source, target), target, atol=1e-8)


def test_affine_maps_are_carried_exactly_everywhere(rng: np.random.Generator) -> None:
    source, vertices = rng.standard_normal((10, 3)), 3 * rng.standard_normal((50, 3))
    A = 2 * Rotation.random(random_state=0).as_matrix() @ np.diag([1, 1, -1])
    np.testing.assert_allclose(thin_plate_warp(vertices, source, source @ A.T + 5), vertices @ A.T + 5, atol=1e-7)


def test_smoothing_follows_noise_less(rng: np.random.Generator) -> None:
    source = rng.standard_normal((30, 3))
    noisy = source + 0.1 * rng.standard_normal((30, 3))
    near = np.linalg.norm(thin_plate_warp(source, source, noisy) - noisy)
    far = np.linalg.norm(thin_plate_warp(source, source, noisy, smoothing=10.0) - noisy)
    assert near < 1e-8 < far


def test_landmarks_that_determine_nothing_are_refused(rng: np.random.Generator) -> None:
    points = rng.standard_normal((6, 3))
    with pytest.raises(InputError, match="at least 5"):
        thin_plate_warp(points, points[:4], points[:4])
    with pytest.raises(InputError, match="for 6 of the source"):
        thin_plate_warp(points, points, points[:5])
    flat = points * [1, 1, 0]
    with pytest.raises(InputError, match="one plane"):
        thin_plate_warp(points, flat, points)
