"""What a second alignment keeps does not depend on its frame, and one that moves is found."""

import numpy as np
import pytest

from collalign.analysis.procrustes import pose_changes
from data_tools.rotations import random_rotation
from tests.data_tools.test_poses import about_z

NUM = 7
ONE_GROUP = np.zeros(NUM, dtype=np.int64)


@pytest.fixture
def poses(rng):
    return np.stack([random_rotation(rng) for _ in range(NUM)])


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_another_frame_changes_nothing(poses, rng, mirror):
    changes, same = pose_changes(poses, mirror * random_rotation(rng) @ poses, ONE_GROUP)
    np.testing.assert_allclose(changes, 0.0, atol=1e-5)
    assert same.all()


def test_the_shapes_that_move_are_named_and_not_the_many_that_agree(poses, rng):
    again = poses.copy()
    again[0], again[3] = about_z(90) @ again[0], again[3] @ np.diag([1.0, 1.0, -1.0])
    changes, same = pose_changes(poses, random_rotation(rng) @ again, ONE_GROUP)
    assert changes[0] == pytest.approx(90.0, abs=1e-4)
    assert np.isnan(changes[3])
    assert same.tolist() == [n != 3 for n in range(NUM)]
    np.testing.assert_allclose(np.delete(changes, [0, 3]), 0.0, atol=1e-4)


def test_groups_may_turn_against_each_other_and_a_single_shape_is_not_compared(poses, rng):
    groups = np.array([0, 0, 0, 1, 1, 1, 2])
    again = poses.copy()
    again[3:6] = random_rotation(rng) @ again[3:6]
    changes, same = pose_changes(poses, again, groups)
    np.testing.assert_allclose(changes[:6], 0.0, atol=1e-5)
    assert np.isnan(changes[6])
    assert same.all()
    assert (pose_changes(poses, again, ONE_GROUP)[0] > 1.0).sum() == 3
