"""Points of a surface, and what is known of them wherever they are moved."""

import numpy as np
import pytest

from data_tools.partial_surface import PartialSurface
from data_tools.poses import Similarity
from data_tools.rotations import random_rotation


@pytest.fixture
def surface(rng):
    points = rng.standard_normal((200, 3)) * [1.0, 0.6, 0.3]
    return PartialSurface.from_user(points, points / np.linalg.norm(points, axis=1, keepdims=True))


def transform(rng):
    shift = rng.standard_normal(3)
    turn = Similarity(rotation=random_rotation(rng), scale=np.float64(2.5), shift=shift)
    return turn.transform


def test_the_nearest_point_to_a_point_is_near_it(surface):
    found = surface.nearest(surface.points)
    distances = np.linalg.norm(surface.points[found] - surface.points, axis=1)
    assert (distances < 0.15 * surface.radius).all()
    assert (surface.nearest(surface.points + 50.0) == -1).all()


def test_the_nearest_points_and_gaps_of_a_moved_surface_are_those_before(surface, rng):
    T_new_old = transform(rng)
    moved = surface.moved(T_new_old)
    places = surface.points + 0.05 * rng.standard_normal(surface.points.shape)
    there = places @ T_new_old[:3, :3].T + T_new_old[:3, 3]
    np.testing.assert_array_equal(moved.nearest(there), surface.nearest(places))
    afresh = PartialSurface.from_user(moved.points, moved.normals)
    np.testing.assert_allclose(moved.gaps, afresh.gaps)
    np.testing.assert_allclose(np.linalg.norm(moved.normals, axis=1), 1.0)
