"""Similarities of one shape and of many, and the greedy choice of rotations that lie apart."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.poses import Similarity, keep_apart, moved_by, pose_angle_deg, scales_of
from data_tools.rotations import random_rotation


def some_poses(rng, num=5):
    return Similarity(
        rotation=np.stack([random_rotation(rng, group="O") for _ in range(num)]),
        scale=rng.uniform(0.5, 2.0, num),
        shift=rng.standard_normal((num, 3)),
    )


def about_z(degrees):
    return Rotation.from_euler("z", degrees, degrees=True).as_matrix()


def test_several_poses_move_points_as_each_alone_and_as_their_matrices():
    rng = np.random.default_rng(0)
    poses, points = some_poses(rng), rng.standard_normal((7, 3))
    for at, moved in enumerate(poses.apply(points)):
        one = poses[at]
        np.testing.assert_allclose(moved, one.scale * points @ one.rotation.T + one.shift)
        np.testing.assert_allclose(one.apply(points), moved)
        np.testing.assert_allclose(moved_by(one.transform, points), moved)
        np.testing.assert_allclose(one.undo(moved), points)
    np.testing.assert_allclose(poses.undo(points)[2], poses[2].undo(points))
    np.testing.assert_array_equal(poses.transform[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (5, 1)))


def test_a_pose_comes_back_from_its_matrix_mirrored_or_not():
    poses = some_poses(np.random.default_rng(1), 8)
    assert {-1.0, 1.0} == set(np.sign(np.linalg.det(poses.rotation)).tolist())
    again = Similarity.of_transforms(poses.transform)
    for name in ("rotation", "scale", "shift"):
        np.testing.assert_allclose(getattr(again, name), getattr(poses, name))
    np.testing.assert_allclose(scales_of(poses.transform[:, :3, :3]), poses.scale)


def test_a_mirror_image_is_half_a_turn_away():
    assert pose_angle_deg(about_z(10), about_z(40)) == pytest.approx(30.0)
    assert pose_angle_deg(about_z(10), -about_z(10)) == 180.0


def test_rotations_are_kept_that_lie_apart_in_their_order():
    rotations = np.stack([about_z(angle) for angle in (0, 4, 9, 20, 22)] + [-about_z(0)])
    assert keep_apart(rotations, 5.0) == [0, 2, 3, 5]
    assert keep_apart(rotations[::-1], 5.0) == [0, 1, 3, 5]
    assert keep_apart(rotations, 5.0, num=2) == [0, 2]
    assert keep_apart(rotations[:0], 5.0) == []
