import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import figure, sphere_mesh
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from data_tools.surface.geodesics import GeodesicSolver, agd_maxima, average_geodesic_distance
from data_tools.surface.shape import Shape


@pytest.fixture(scope="module")
def sphere():
    return Shape.from_arrays(*sphere_mesh(2000), name="sphere")


def agd_of(shape, num=64):
    sources = farthest_points(shape, num, metric="euclidean")
    return average_geodesic_distance(shape, GeodesicSolver(shape), sources)


@pytest.mark.parametrize(("kind", "tolerance"), [("heat", 0.03), ("cloud", 0.12)])
def test_distances_on_the_sphere_are_angles(sphere, kind, tolerance):
    shape = sphere if kind == "heat" else Shape.from_arrays(sphere.vertices)
    solver = GeodesicSolver(shape)
    assert solver.method == ("heat" if kind == "heat" else "shortest paths")
    exact = np.arccos(np.clip(sphere.vertices @ sphere.vertices[17], -1, 1))
    np.testing.assert_allclose(solver.from_vertex(17), exact, atol=tolerance * np.pi)


def test_several_sources_give_the_nearest(sphere):
    solver = GeodesicSolver(sphere)
    both = solver.from_vertices(np.array([3, 1200]))
    alone = np.minimum(solver.from_vertex(3), solver.from_vertex(1200))
    np.testing.assert_allclose(both, alone, atol=0.1)
    with pytest.raises(InputError, match="sources"):
        solver.from_vertex(2000)


def test_two_components_are_infinitely_far_apart():
    vertices, faces = sphere_mesh(50)
    two = Shape.from_arrays(
        np.concatenate([vertices, vertices + 5]), np.concatenate([faces, faces + 50])
    )
    solver = GeodesicSolver(two)
    assert solver.method == "shortest paths"
    distances = solver.from_vertex(0)
    assert np.isfinite(distances[:50]).all()
    assert np.isinf(distances[50:]).all()
    agd = agd_of(two, 10)
    assert np.isfinite(agd).all()
    small = agd_of(Shape.from_arrays(two.vertices / 100, two.faces), 10)
    np.testing.assert_allclose(small, agd, rtol=0.1)


def test_average_distance_on_the_sphere_is_known(sphere):
    # The mean angle over the sphere is pi / 2; sqrt(area) is sqrt(4 pi).
    np.testing.assert_allclose(agd_of(sphere), np.pi / 2 / np.sqrt(4 * np.pi), rtol=0.04)


def test_maxima_are_the_tips_of_the_limbs():
    shape = figure()
    solver = GeodesicSolver(shape)
    tips = agd_maxima(agd_of(shape), solver, num=5, radius=0.2 * shape.area**0.5)
    found = shape.vertices[tips]
    corners = np.array([[2, 1, 12], [19, 1, 12], [8, 1, 0], [11, 1, 1], [9, 1, 17]], dtype=float)
    nearest = np.linalg.norm(found[:, None] - corners, axis=2).argmin(axis=0)
    assert len(set(nearest)) == 5
