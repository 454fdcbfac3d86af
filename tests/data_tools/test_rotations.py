import numpy as np
import pytest

from data_tools.errors import OptionsError
from data_tools.rotations import (
    nearest_orthogonal,
    random_rotation,
    rotation_angle_deg,
    rotation_angles,
)
from tests.data_tools.test_poses import about_z


def test_random_rotations_are_orthogonal_and_of_the_group(rng):
    for dim in (2, 3, 5):
        drawn = np.stack([random_rotation(rng, dim, group="O") for _ in range(40)])
        np.testing.assert_allclose(
            drawn @ drawn.transpose(0, 2, 1), np.broadcast_to(np.eye(dim), drawn.shape), atol=1e-12
        )
        assert set(np.sign(np.linalg.det(drawn))) == {-1.0, 1.0}
        assert np.linalg.det(random_rotation(rng, dim)) > 0
    with pytest.raises(OptionsError, match="group"):
        random_rotation(rng, group="U")


def test_random_rotations_are_uniform(rng):
    drawn = np.stack([random_rotation(rng) for _ in range(3000)])
    assert np.abs(drawn.mean(axis=0)).max() < 0.05
    np.testing.assert_allclose((drawn**2).mean(axis=0), 1 / 3, atol=0.03)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1.0, 90.0, 179.9999, 180.0])
def test_angles_of_known_turns(angle):
    assert rotation_angle_deg(about_z(angle)) == pytest.approx(angle, rel=1e-6, abs=1e-9)
    assert rotation_angle_deg(about_z(20), about_z(20 + angle)) == pytest.approx(
        angle, rel=1e-6, abs=1e-6
    )


def test_no_angle_between_hands():
    assert np.isnan(rotation_angle_deg(-np.eye(3)))
    assert rotation_angle_deg(-np.eye(3), -np.eye(3)) == 0


def test_angles_between_chiralities_are_half_a_turn():
    assert rotation_angles(np.eye(3), np.diag([1.0, 1.0, -1.0])) == np.pi
    assert rotation_angles(np.eye(3), np.diag([1.0, -1.0, -1.0])) == pytest.approx(np.pi)
    assert rotation_angles(np.eye(3), about_z(1e-6)) == pytest.approx(np.radians(1e-6), rel=1e-6)


@pytest.mark.parametrize("dim", [2, 3, 5])
def test_no_orthogonal_matrix_is_nearer_than_the_nearest(rng, dim):
    matrices = rng.standard_normal((6, dim, dim))
    others = np.stack([random_rotation(rng, dim, group="O") for _ in range(200)])
    for determinant in (None, 1.0, -1.0):
        found = nearest_orthogonal(matrices, determinant=determinant)
        np.testing.assert_allclose(
            found @ found.transpose(0, 2, 1), np.broadcast_to(np.eye(dim), found.shape), atol=1e-12
        )
        allowed = others if determinant is None else others[np.linalg.det(others) * determinant > 0]
        if determinant is not None:
            np.testing.assert_allclose(np.linalg.det(found), determinant)
        distances = np.linalg.norm(matrices[:, None] - allowed, axis=(2, 3))
        assert (np.linalg.norm(matrices - found, axis=(1, 2)) <= distances.min(axis=1)).all()
        np.testing.assert_array_equal(
            nearest_orthogonal(matrices[0], determinant=determinant), found[0]
        )
