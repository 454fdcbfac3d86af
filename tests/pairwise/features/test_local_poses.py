"""Matches of descriptors vote for poses, which are refined from points to planes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.surface_points import surface_cells
from data_tools.local_surface import LocalSurface
from data_tools.poses import Similarity, pose_angle_deg
from data_tools.rotations import random_rotation
from pairwise.features.poses import (
    _compatible,
    consensus_poses,
    feature_distances,
    match_features,
    refine_on_planes,
    rotations_by,
)

CELL = 0.13


@pytest.fixture(scope="module")
def surface():
    return surface_cells(blob(np.random.default_rng(5), num_vertices=900), CELL)


def placed(surface, rotation, shift):
    """The surface whose pose on the given one is that rotation and shift."""
    return LocalSurface.from_user(
        (surface.points - shift) @ rotation, surface.normals @ rotation, surface.cell
    )


def test_matches_agree_where_a_rigid_motion_holds_both(rng):
    """Points on a line whose normals are across it: turning one about the line changes only their cosine."""
    points = np.arange(4.0)[:, None] * [1.0, 0.0, 0.0]
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    turn = random_rotation(rng)
    far = 1.0 - np.eye(4)
    assert np.array_equal(_compatible((points, normals), (points @ turn, normals @ turn), 0.2), far)
    for change in (
        lambda p, n: (p, np.where(np.arange(4)[:, None] == 0, [0.0, 1.0, 0.0], n)),
        lambda p, n: (p - np.array([[5.0], [0.0], [0.0], [0.0]]) * [1.0, 0.0, 0.0], n),
        lambda p, n: (p, np.where(np.arange(4)[:, None] == 0, [0.8, 0.0, 0.6], n)),
    ):
        found = _compatible((points, normals), change(points, normals), 0.2)
        assert found[0].max() == found[:, 0].max() == 0
        assert np.array_equal(found[1:, 1:], far[1:, 1:])


def test_distances_are_those_of_the_unit_vectors(surface):
    few = LocalSurface.from_user(surface.points[:40], surface.normals[:40], CELL)
    found = feature_distances(surface.features, few.features)
    plain = ((surface.features[:, None] - few.features) ** 2).sum(axis=2)
    np.testing.assert_allclose(found, plain, atol=1e-5)
    assert found.shape == (len(surface.points), 40)


def test_each_point_is_matched_with_its_two_nearest_descriptors_both_ways(rng):
    distances = rng.random((6, 4)).astype(np.float32)
    wanted = {(i, j) for i in range(6) for j in np.argsort(distances[i])[:2].tolist()}
    wanted |= {(i, j) for j in range(4) for i in np.argsort(distances[:, j])[:2].tolist()}
    to, of = match_features(distances)
    assert len(to) == len(wanted)
    assert {*zip(to.tolist(), of.tolist(), strict=True)} == wanted


def test_matches_that_hardly_any_others_support_give_no_pose(surface):
    two = np.array([0, len(surface.points) - 1])
    rotations, shifts = consensus_poses(surface, surface, (two, two), 3)
    assert (rotations.shape, shifts.shape) == ((0, 3, 3), (0, 3))


def test_refinement_finds_the_scale_within_its_range(surface, rng):
    rotation, shift = random_rotation(rng), np.array([0.4, -0.2, 1.0])
    source = placed(surface, rotation, shift)
    first = Similarity(
        rotation=Rotation.from_rotvec(np.deg2rad(6.0) * np.eye(3)).as_matrix() @ rotation,
        scale=np.full(3, 0.85),
        shift=shift + 0.7 * CELL * np.eye(3),
    )
    found = refine_on_planes(surface, source, first, scale_range=(0.5, 2.0))
    assert pose_angle_deg(found.rotation, rotation).max() < 0.5
    np.testing.assert_allclose(found.scale, 1.0, atol=0.01)
    assert refine_on_planes(surface, source, first, scale_range=(0.5, 0.9)).scale.max() <= 0.9


def test_rotations_by_vectors_are_those_of_scipy(rng):
    vectors = np.concatenate(
        [rng.standard_normal((5, 3)), np.zeros((1, 3)), 1e-9 * rng.standard_normal((1, 3))]
    )
    np.testing.assert_allclose(
        rotations_by(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-12
    )
