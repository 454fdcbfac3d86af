"""Refinement on dense samples: recovers a disturbed pose, never raises its own energy, keeps chirality."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import crown
from data_tools.errors import InputError, OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.normals import outward_normals
from pairwise.dense.points import DenseMatcher, DensePoints
from pairwise.dense.refine import refine_pose


def some_shape(num=300):
    shape = crown(np.random.default_rng(0), num_vertices=num)
    return shape.vertices, outward_normals(shape)


@pytest.mark.parametrize("mirrored", [False, True])
def test_exact_pose_scale_and_shift_are_recovered(mirrored, rng):
    points, normals = some_shape()
    turn = random_rotation(rng) @ (np.diag([1.0, 1.0, -1.0]) if mirrored else np.eye(3))
    source = DensePoints.from_user(2.5 * (points @ turn) + [1.0, 2.0, 3.0], normals @ turn)
    start = turn @ Rotation.from_rotvec([0.1, -0.08, 0.05]).as_matrix()
    refined = refine_pose(DensePoints.from_user(points, normals), source, start)
    assert rotation_angle_deg(refined.pose.rotation, turn) < 0.01
    assert refined.pose.scale == pytest.approx(0.4)
    assert refined.energy < 1e-8
    moved = refined.pose.scale * source.points @ refined.pose.rotation.T + refined.pose.shift
    assert np.allclose(moved, points, atol=1e-4)


def test_without_scale_and_normals(rng):
    points, normals = some_shape()
    turn = Rotation.from_rotvec([0.05, 0.1, 0.0]).as_matrix()
    plain = refine_pose(
        DensePoints.from_user(points),
        DensePoints.from_user(points @ turn),
        np.eye(3),
        estimate_scale=False,
    )
    assert plain.pose.scale == 1.0
    assert rotation_angle_deg(plain.pose.rotation, turn) < 0.01
    mixed = refine_pose(
        DensePoints.from_user(points, normals), DensePoints.from_user(points @ turn), np.eye(3)
    )
    assert np.allclose(mixed.pose.rotation, plain.pose.rotation, atol=1e-3)


def test_far_start_ends_elsewhere():
    """The recovery test can fail: from half a turn away the answer is another one."""
    points, _ = some_shape()
    shape = DensePoints.from_user(points)
    refined = refine_pose(shape, shape, np.diag([-1.0, -1.0, 1.0]))
    assert rotation_angle_deg(refined.pose.rotation) > 30


def test_bad_input_is_refused():
    points, _ = some_shape(100)
    shape = DensePoints.from_user(points)
    with pytest.raises(InputError, match="one place"):
        DensePoints.from_user(np.ones((5, 3)))
    with pytest.raises(InputError, match="normals"):
        DensePoints.from_user(points, points[:5])
    with pytest.raises(InputError, match="not orthogonal"):
        refine_pose(shape, shape, 2 * np.eye(3))
    with pytest.raises(InputError, match="invariants"):
        refine_pose(shape, DensePoints.from_user(points, invariants=points[:, :1]), np.eye(3))
    for wrong in ({"normal_weight": -1.0}, {"max_iterations": 0}):
        with pytest.raises(OptionsError, match=next(iter(wrong))):
            refine_pose(shape, shape, np.eye(3), **wrong)


def test_nearest_neighbours_in_slabs_are_those_of_trees_wherever_the_source_moves(rng, monkeypatch):
    points, normals = some_shape()
    source = DensePoints.from_user(rng.permutation(points)[:200])
    matcher = DenseMatcher(DensePoints.from_user(points, normals), source)
    monkeypatch.setattr("pairwise.dense.points._CHUNK_ENTRIES", 7_000)
    for turn in Rotation.from_rotvec(
        np.outer([3.0, 0.1, 0.11, 0.111, 0.5, 0.5], [0.6, 0.0, 0.8])
    ).as_matrix():
        pose = Similarity(rotation=turn, scale=1.1, shift=0.1 * turn[0])
        of_target, of_source = matcher.pair_up(pose)
        np.testing.assert_array_equal(
            of_target[:200], cKDTree(points).query(pose.apply(source.points))[1]
        )
        np.testing.assert_array_equal(
            of_source[200:], cKDTree(pose.apply(source.points)).query(points)[1]
        )


def test_invariants_count_and_decide(rng):
    """A box looks the same from both ends; a scalar along it tells them apart, and its cost is part of the energy."""
    points = rng.random((200, 3)) * [3.0, 1.0, 1.0]
    points = np.concatenate(
        [points, points * [-1, 1, -1], points * [-1, -1, 1], points * [1, -1, -1]]
    )
    plain = DensePoints.from_user(points)
    marked = DensePoints.from_user(points, invariants=points[:, :1])
    half_turn = np.diag([-1.0, -1.0, 1.0])
    assert refine_pose(plain, plain, half_turn).energy == pytest.approx(0.0, abs=1e-12)
    assert refine_pose(marked, marked, np.eye(3)).energy == pytest.approx(0.0, abs=1e-12)
    assert refine_pose(marked, marked, half_turn).energy > 0.1
