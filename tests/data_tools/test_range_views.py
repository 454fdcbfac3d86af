"""Range scans of a mesh: points on it that a camera sees."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_tools.datasets.synthetic import range_view
from data_tools.datasets.synthetic_shapes import blob, sphere_mesh
from data_tools.embedding.surface_points import centre_and_radius, spread_over_triangles
from data_tools.errors import OptionsError
from data_tools.surface.shape import Shape


def seen(shape, direction, **options):
    return range_view(
        shape, np.asarray(direction, dtype=float), rng=np.random.default_rng(0), **options
    )


def test_points_of_a_view_lie_on_the_mesh_and_nothing_hides_them():
    shape = blob(np.random.default_rng(1), num_vertices=800)
    direction = np.array([0.6, 0.0, 0.8])
    points = seen(shape, direction)
    every = spread_over_triangles(shape, 0.02)[0]
    radius = centre_and_radius(shape)[1]
    assert cKDTree(every).query(points)[0].max() < 0.05 * radius
    across = np.linalg.svd(direction[None])[2][1:].T
    tree = cKDTree(every @ across)
    for point in points[:: len(points) // 60]:
        beside = every[tree.query_ball_point(point @ across, 0.01 * radius)]
        assert ((beside - point) @ direction).max() < 0.35 * radius
    hidden = every[np.argmin(every @ direction)]
    assert cKDTree(points).query(hidden)[0] > 0.3 * radius


def test_finer_pixels_see_more_and_clouds_are_refused():
    shape = Shape.from_arrays(*sphere_mesh(1000), name="sphere")
    assert len(seen(shape, [1.0, 0.0, 0.0], pixels=60)) > 3 * len(
        seen(shape, [1.0, 0.0, 0.0], pixels=30)
    )
    with pytest.raises(OptionsError, match="mesh"):
        seen(Shape.from_arrays(shape.vertices, name="cloud"), [1.0, 0.0, 0.0])
