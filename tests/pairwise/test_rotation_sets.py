"""Starts: covering sets of rotations, principal axes, signs, small turns."""

import numpy as np
import pytest

from data_tools.errors import OptionsError
from data_tools.rotations import rotation_angles
from pairwise.rotation_sets import (
    principal_frame,
    quaternions_to_rotations,
    random_rotations,
    rotation_set,
    sign_rotations,
    small_rotations,
    super_fibonacci,
)


def assert_rotations(matrices):
    dim = matrices.shape[-1]
    np.testing.assert_allclose(
        np.swapaxes(matrices, -1, -2) @ matrices,
        np.broadcast_to(np.eye(dim), matrices.shape),
        atol=1e-12,
    )
    np.testing.assert_allclose(np.linalg.det(matrices), 1.0, atol=1e-12)


def test_the_helper_rejects_a_reflection():
    with pytest.raises(AssertionError):
        assert_rotations(np.diag([1.0, 1.0, -1.0])[None])


@pytest.mark.parametrize("dim", [1, 2, 3, 4, 7])
def test_every_set_holds_rotations_and_repeats_itself(dim):
    found = rotation_set(dim, 30, seed=3)
    assert_rotations(found)
    np.testing.assert_array_equal(found, rotation_set(dim, 30, seed=3))


def test_the_set_covers_space_better_than_random_rotations():
    num = 500
    probes = random_rotations(3, 2000, np.random.default_rng(5))

    def radius(rotations):
        return max(float(rotation_angles(rotations, probe).min()) for probe in probes)

    even, random = (
        radius(rotation_set(3, num)),
        radius(random_rotations(3, num, np.random.default_rng(6))),
    )
    assert even < 0.8 * random
    assert np.rad2deg(even) < 30


def test_super_fibonacci_quaternions_are_unit_and_give_the_usual_matrices():
    np.testing.assert_allclose(np.linalg.norm(super_fibonacci(50), axis=1), 1.0)
    half = np.sqrt(0.5)
    quarter = quaternions_to_rotations(np.array([half, 0.0, 0.0, half]))
    np.testing.assert_allclose(quarter, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)


def test_an_empty_set_is_refused():
    with pytest.raises(OptionsError, match="at least 1"):
        rotation_set(3, 0)


@pytest.mark.parametrize("dim", [2, 3, 5])
def test_the_principal_frame_turns_with_the_points(rng, dim):
    points = rng.gamma(1.0, size=(40, dim)) * np.arange(1, dim + 1)
    turn = random_rotations(dim, 1, rng)[0]
    frame = principal_frame(points, np.ones(40))
    assert_rotations(frame[None])
    assert (((points @ frame) ** 3).sum(axis=0)[:-1] > 0).all()
    np.testing.assert_allclose(
        principal_frame(points @ turn.T, np.ones(40)), turn @ frame, atol=1e-9
    )


def test_signs_are_all_rotations_of_the_axes():
    signs = sign_rotations(3, 16)
    assert len(signs) == 4
    assert_rotations(signs)
    np.testing.assert_array_equal(signs[0], np.eye(3))
    many = sign_rotations(12, 40, seed=1)
    assert_rotations(many)
    assert len(np.unique(many.reshape(len(many), -1), axis=0)) == len(many) <= 40


@pytest.mark.parametrize("dim", [2, 3, 6])
def test_small_turns_have_the_angle_asked_for(dim):
    turns = small_rotations(dim, 12, 0.3)
    assert_rotations(turns)
    if dim <= 3:
        np.testing.assert_allclose(rotation_angles(turns, np.eye(dim)), 0.3)
        assert np.abs((turns - np.swapaxes(turns, 1, 2)).mean(axis=0)).max() < 0.05, "even axes"


def test_the_spiral_runs_through_the_middles_of_its_steps():
    points = super_fibonacci(40)
    shares = (points[:, :2] ** 2).sum(axis=1)  # even in the square of the first radius
    np.testing.assert_allclose(shares, (np.arange(40) + 0.5) / 40)
