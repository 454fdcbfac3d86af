"""Decimated meshes lie on the surface they come from."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.decimation import decimate


def largest_gap(points, vertices, faces):
    places = SurfaceLocator(vertices, faces).closest(points).on(vertices)
    return float(np.linalg.norm(places - points, axis=1).max())


def test_a_small_mesh_stays_as_it_is(rng):
    shape = blob(rng, num_vertices=200)
    vertices, faces = decimate(shape.vertices, shape.faces, 1000)
    np.testing.assert_array_equal(vertices, shape.vertices)
    np.testing.assert_array_equal(faces, shape.faces)


def test_collapses_keep_the_surface(rng):
    shape = blob(rng, num_vertices=3000)
    vertices, faces = decimate(shape.vertices, shape.faces, 800)
    assert 700 < len(faces) <= 800
    assert largest_gap(shape.vertices, vertices, faces) < 0.03


@pytest.mark.parametrize("unit", [1e-3, 7.0, 1e4])
def test_the_unit_of_length_decides_nothing(rng, unit):
    shape = blob(rng, num_vertices=3000)
    vertices, faces = decimate(shape.vertices, shape.faces, 800)
    others, triangles = decimate(unit * shape.vertices, shape.faces, 800)
    np.testing.assert_array_equal(triangles, faces)
    np.testing.assert_allclose(others / unit, vertices, atol=1e-9)
