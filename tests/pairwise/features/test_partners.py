"""Nearest points whose normals agree are those that a look at all points finds."""

import numpy as np
import pytest

from data_tools.local_surface import SurfacePlanes
from pairwise.features.partners import nearest_facing


def oriented(rng, num, spread):
    normals = rng.standard_normal((num, 3))
    return spread * rng.random((num, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def surface_of(points, normals):
    return SurfacePlanes(points=points, normals=normals, cell=1.0)


def of_all(others, own, reach, cosine):
    squares = ((own[0][:, None] - others[0]) ** 2).sum(axis=2)
    squares[own[1] @ others[1].T <= cosine] = np.inf
    squares[squares >= reach**2] = np.inf
    return squares.min(axis=1), squares.argmin(axis=1)


@pytest.mark.parametrize("reach", [0.02, 0.1, 0.7, 30.0])
@pytest.mark.parametrize("spread", [(1.0, 1.0, 1.0), (40.0, 0.1, 1.0), (1.0, 1.0, 0.0)])
def test_the_nearest_facing_points_are_found(rng, reach, spread):
    others = oriented(rng, 300, np.array(spread))
    own = oriented(rng, 200, 1.6 * np.array(spread))
    own = own[0] - 0.3 * np.array(spread), own[1]
    squares, nearest = nearest_facing(surface_of(*others), own, reach=reach, cosine=0.3)
    expected = of_all(others, own, reach, 0.3)
    np.testing.assert_allclose(squares, expected[0], rtol=1e-9)
    found = np.isfinite(squares)
    np.testing.assert_array_equal(nearest[found], expected[1][found])
    assert np.isinf(squares).any() or reach > 0.5


def test_points_in_the_corners_of_the_grid_are_found_from_outside(rng):
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    up = np.tile([0.0, 0.0, 1.0], (8, 1))
    moved = corners + 0.09 * (2.0 * corners - 1.0)
    surface = surface_of(corners, up)
    squares, nearest = nearest_facing(surface, (moved, up), reach=0.2, cosine=0.7)
    np.testing.assert_array_equal(nearest, np.arange(8))
    np.testing.assert_allclose(squares, 3 * 0.09**2)
    assert np.isinf(nearest_facing(surface, (moved, -up), reach=0.2, cosine=0.7)[0]).all()
    assert np.isinf(nearest_facing(surface, (moved, up), reach=0.15, cosine=0.7)[0]).all()
