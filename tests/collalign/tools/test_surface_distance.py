"""Distances of surfaces: what theory says of any of them."""

import numpy as np
import pytest

from collalign.tools.classify.surface_distance import distances_at_poses, near_pairs, surface_distances, unit_cloud
from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import crown, figure
from data_tools.embedding.sampling import farthest_points


def cloud(shape):
    return unit_cloud(shape.vertices[farthest_points(shape, 150, metric="euclidean")])


@pytest.fixture(scope="module")
def clouds():
    rng = np.random.default_rng(0)
    tooth, body = crown(rng, num_vertices=400), figure()
    return [cloud(s) for s in (tooth, bumped(tooth, rng, rms=0.01), body, bumped(body, rng, rms=0.01))]


def test_a_shape_is_nearer_to_its_own_kind(clouds):
    distances = surface_distances(clouds, np.zeros(4, dtype=np.int64))
    np.testing.assert_array_equal(distances, distances.T)
    assert (np.diag(distances) == 0).all()
    away = distances + np.diag([np.inf] * 4)
    assert away.argmin(axis=1).tolist() == [1, 0, 3, 2]


def test_refining_takes_back_a_turn_that_the_poses_left(clouds):
    angle = 0.1
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turned = [clouds[0], 1.7 * clouds[0] @ turn.T]
    groups = np.zeros(2, dtype=np.int64)
    assert distances_at_poses(turned)[0, 1] > 0.01
    assert surface_distances(turned, groups)[0, 1] < 1e-3


def test_shapes_of_other_groups_have_no_distance(clouds):
    distances = surface_distances(clouds, np.array([0, 0, 1, 1]))
    assert np.isnan(distances[:2, 2:]).all()
    assert np.isfinite(distances[:2, :2]).all()
    assert (2, 1) not in near_pairs(distances, 3)
