"""Closest points against a dense search over the triangles, and what must hold for any of them."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import crown, sphere_mesh
from data_tools.surface.closest import SurfaceLocator
from tests.data_tools.surface.test_triangle_tree import all_triangles


@pytest.mark.parametrize("stretch", [1.0, 30.0])
def test_the_locator_sees_what_all_triangles_together_see(stretch):
    """Long triangles have their centroids far away: the first list misses them."""
    rng = np.random.default_rng(1)
    vertices, faces = sphere_mesh(60)
    vertices = vertices * [stretch, 1, 1]
    fine = crown(rng, num_vertices=300)
    both = np.concatenate([vertices, fine.vertices + np.array([0, 0, 1.5])])
    triangles = np.concatenate([faces, fine.faces + len(vertices)])
    points = rng.normal(size=(80, 3)) * [stretch, 1.5, 1.5]
    places = SurfaceLocator(both, triangles).closest(points)
    found = np.linalg.norm(places.on(both) - points, axis=1)
    np.testing.assert_allclose(found, all_triangles(points, both, triangles), atol=1e-12)


def test_the_closest_place_of_a_cloud_is_a_point():
    cloud = np.random.default_rng(2).random((30, 3))
    places = SurfaceLocator(cloud, np.empty((0, 3), dtype=np.int64)).closest(cloud[::-1] + 1e-6)
    np.testing.assert_array_equal(places.on(cloud), cloud[::-1])
