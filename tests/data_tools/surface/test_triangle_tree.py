"""The closest triangle against all triangles, and the closest place on one against a fine grid."""

import numpy as np

from data_tools.surface.triangle_tree import (
    closest_on_triangle,
    closest_on_triangles,
    closest_triangles,
    triangle_tree,
)


def grid_distance(point, triangle, num=120):
    """Return the least distance to a fine grid of places on a triangle: never less than the true one."""
    u, v = np.meshgrid(np.linspace(0, 1, num), np.linspace(0, 1, num))
    inside = u + v <= 1
    weights = np.stack([1 - u[inside] - v[inside], u[inside], v[inside]], axis=1)
    return float(np.linalg.norm(weights @ triangle - point, axis=1).min())


def all_triangles(points, vertices, faces):
    """Return the distance of each point to a surface, every triangle looked at."""
    return np.array(
        [
            min(
                np.linalg.norm(np.array(closest_on_triangle(point, one)) @ one - point)
                for one in vertices[faces]
            )
            for point in points
        ]
    )


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
    weights = np.array(closest_on_triangle(np.array([0.5, 1.0, 0.0]), needle))
    np.testing.assert_allclose(weights @ needle, [0.5, 0, 0], atol=1e-12)


def test_the_tree_finds_the_nearest_of_all_triangles_and_of_equals_the_first():
    rng = np.random.default_rng(4)
    vertices, faces = rng.standard_normal((40, 3)), rng.integers(0, 40, (120, 3))
    points = 2 * rng.standard_normal((50, 3))
    triangles, weights = closest_triangles(triangle_tree(vertices, faces), points)
    places = np.einsum("qc,qcd->qd", weights, vertices[faces[triangles]])
    found = np.linalg.norm(places - points, axis=1)
    np.testing.assert_allclose(found, all_triangles(points, vertices, faces), atol=1e-12)
    twice = closest_triangles(triangle_tree(vertices, np.tile(faces, (2, 1))), points)[0]
    assert (twice < len(faces)).all()
