"""Decimated meshes lie on the surface they come from, whether vertices were put together first or not."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.surface.cleaning import decimate
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.topology import counted_edges, face_areas


def largest_gap(points, vertices, faces):
    places = SurfaceLocator(vertices, faces).closest(points).on(vertices)
    return float(np.linalg.norm(places - points, axis=1).max())


@pytest.mark.parametrize("unit", [1e-3, 7.0, 1e4])
def test_the_unit_of_length_decides_nothing(rng, unit):
    shape = blob(rng, num_vertices=3000)
    vertices, faces = decimate(shape.vertices, shape.faces, 800)
    others, triangles = decimate(unit * shape.vertices, shape.faces, 800)
    np.testing.assert_array_equal(triangles, faces)
    np.testing.assert_allclose(others / unit, vertices, atol=1e-9)


def test_clusters_keep_the_surface_and_leave_fewer_collapses(rng):
    shape = blob(rng, num_vertices=20_000)
    clustered, triangles = decimate(shape.vertices, shape.faces, 10**6, most_collapsed=6_000)
    assert 1_000 < len(clustered) < 3_000
    _, num_faces = counted_edges(triangles)
    assert num_faces.min() == 2
    assert (num_faces > 2).mean() < 0.02  # of triangles that lie on each other none is left
    vertices, faces = decimate(shape.vertices, shape.faces, 800, most_collapsed=6_000)
    assert len(faces) <= 800
    assert largest_gap(shape.vertices, vertices, faces) < 0.05
    assert face_areas(vertices, faces).sum() == pytest.approx(
        face_areas(shape.vertices, shape.faces).sum(), rel=0.03
    )
