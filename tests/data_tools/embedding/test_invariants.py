import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob, crown, sphere_mesh
from data_tools.embedding.invariants import (
    boundary_distance,
    heat_kernel_signature,
    standardised,
)
from data_tools.surface.geodesics import GeodesicSolver
from data_tools.surface.laplacian import spectrum, surface_operators
from data_tools.surface.shape import Shape


def test_heat_kernel_of_the_sphere_is_constant_and_known():
    eigen = spectrum(surface_operators(Shape.from_arrays(*sphere_mesh(2500))), 63)
    # Unit area: h_t = sum_l (2 l + 1) exp(-4 pi l (l + 1) t); 63 functions are l <= 7.
    degrees = np.arange(8)
    for time in (0.01, 0.03, 0.1):
        exact = np.log(
            ((2 * degrees + 1) * np.exp(-4 * np.pi * degrees * (degrees + 1) * time)).sum()
        )
        np.testing.assert_allclose(heat_kernel_signature(eigen, (time,)), exact, atol=0.02)


def test_boundary_distance_is_zero_on_the_rim_and_on_closed_surfaces(rng):
    shape = crown()
    distance = boundary_distance(shape, GeodesicSolver(shape))
    lowest = shape.vertices[:, 2] <= np.quantile(shape.vertices[:, 2], 0.02)
    assert distance[lowest].max() < 0.15
    assert shape.vertices[distance.argmax(), 2] > np.quantile(shape.vertices[:, 2], 0.7)
    big = Shape.from_arrays(10 * shape.vertices, shape.faces)
    np.testing.assert_allclose(
        boundary_distance(big, GeodesicSolver(big)), distance, rtol=1e-6, atol=1e-9
    )
    closed = blob(rng, num_vertices=200)
    assert not boundary_distance(closed, GeodesicSolver(closed)).any()
    cloud = Shape.from_arrays(closed.vertices)
    assert not boundary_distance(cloud, GeodesicSolver(cloud)).any()


def test_standardised_columns(rng):
    values = rng.standard_normal((50, 3)) * [1.0, 100.0, 0.0] + 5.0
    chosen = np.arange(0, 50, 2)
    result = standardised(values, chosen)
    np.testing.assert_allclose(result.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose((result**2).sum(axis=0), [1 / 3, 1 / 3, 0.0])
    assert np.linalg.norm(standardised(values[:, :2], chosen)) == pytest.approx(1.0)
