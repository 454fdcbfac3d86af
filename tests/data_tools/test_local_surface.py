"""Surfaces at the spacing of a cell: their descriptors, which mirroring reverses."""

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.local_surface import NUM_BINS, LocalSurface
from data_tools.surface.point_features import fast_point_features
from tests.neighbourhoods import bumpy


def test_a_mirrored_surface_has_the_descriptors_of_the_mirrored_points():
    points, normals = bumpy()
    flip = np.array([-1.0, 1.0, 1.0])
    surface = LocalSurface.from_user(points, normals, 0.14)
    mirrored, again = (
        surface.mirrored,
        LocalSurface.from_user(points * flip, normals * flip, 0.14),
    )
    np.testing.assert_array_equal(mirrored.points, again.points)
    np.testing.assert_array_equal(mirrored.normals, again.normals)
    np.testing.assert_allclose(mirrored.features, again.features, atol=1e-6)
    assert np.abs(mirrored.features - surface.features).max() > 0.05
    np.testing.assert_array_equal(mirrored.mirrored.histograms, surface.histograms)


def test_descriptors_are_unit_vectors_near_the_roots_of_the_histograms():
    points, normals = bumpy()
    surface = LocalSurface.from_user(points, normals, 0.14)
    np.testing.assert_allclose(np.linalg.norm(surface.features, axis=1), 1.0, atol=1e-5)
    roots = np.sqrt(fast_point_features(points, normals, 0.7, NUM_BINS))
    np.testing.assert_allclose(surface.features, roots, atol=0.006)


@pytest.mark.parametrize(
    ("points", "normals", "cell", "name"),
    [
        (np.full((9, 3), np.nan), np.ones((9, 3)), 1.0, "points"),
        (np.ones((3, 3)), np.ones((3, 3)), 1.0, "points"),
        (np.ones((9, 3)), np.ones((8, 3)), 1.0, "normals"),
        (np.ones((9, 3)), np.ones((9, 3)), 0.0, "cell"),
        (np.ones((9, 3)), np.ones((9, 3)), np.inf, "cell"),
    ],
)
def test_bad_arrays_are_named(points, normals, cell, name):
    with pytest.raises(InputError, match=name):
        LocalSurface.from_user(points, normals, cell)
