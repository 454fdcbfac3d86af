"""Closest points against a dense search over the triangles, and what must hold for any of them."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import crown, sphere_mesh
from data_tools.surface.closest import SurfaceLocator, closest_on_triangles


def grid_distance(point, triangle, num=120):
    """Return the least distance to a fine grid of places on a triangle: never less than the true one."""
    u, v = np.meshgrid(np.linspace(0, 1, num), np.linspace(0, 1, num))
    inside = u + v <= 1
    weights = np.stack([1 - u[inside] - v[inside], u[inside], v[inside]], axis=1)
    return float(np.linalg.norm(weights @ triangle - point, axis=1).min())


def all_triangles(points, vertices, faces):
    """Return the distance of each point to a surface, every triangle looked at."""
    corners = np.broadcast_to(vertices[faces], (len(points), len(faces), 3, 3))
    places = np.einsum("qfc,qfcd->qfd", closest_on_triangles(points[:, None], corners), corners)
    return np.asarray(np.linalg.norm(places - points[:, None], axis=2).min(axis=1))


def test_a_triangle_is_met_where_a_fine_grid_says():
    rng = np.random.default_rng(0)
    triangles, points = rng.normal(size=(60, 3, 3)), rng.normal(size=(60, 3)) * 2
    weights = closest_on_triangles(points, triangles)
    found = np.linalg.norm(np.einsum("qc,qcd->qd", weights, triangles) - points, axis=1)
    expected = [grid_distance(p, t) for p, t in zip(points, triangles, strict=True)]
    assert (found <= np.array(expected) + 1e-12).all()
    np.testing.assert_allclose(found, expected, atol=0.03)
    np.testing.assert_allclose(weights.sum(axis=1), 1)


def test_the_grid_refuses_a_wrong_place():
    triangle = np.eye(3)
    assert grid_distance(np.zeros(3), triangle) < np.linalg.norm(triangle[0]) - 0.3


def test_triangles_without_area_are_their_edges():
    needle = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    weights = closest_on_triangles(np.array([0.5, 1.0, 0.0]), needle)
    np.testing.assert_allclose(weights @ needle, [0.5, 0, 0], atol=1e-12)


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


def test_places_move_with_the_vertices():
    shape = crown(np.random.default_rng(3), num_vertices=200)
    points = shape.vertices[::7] * 1.01
    places = SurfaceLocator(shape.vertices, shape.faces).closest(points)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        places.on(shape.vertices @ turn.T), places.on(shape.vertices) @ turn.T, atol=1e-12
    )
