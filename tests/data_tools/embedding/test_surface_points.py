"""Points one cell apart with outward normals, of meshes and clouds alike."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_tools.datasets.synthetic_shapes import blob, crown, sphere_mesh
from data_tools.embedding.surface_points import (
    centre_and_radius,
    cloud_rim,
    plane_normals,
    spread_over_triangles,
    spread_points,
    surface_cells,
)
from data_tools.local_surface import shows_scene
from data_tools.surface.shape import Shape


def sphere(num=1500):
    return Shape.from_arrays(*sphere_mesh(num), name="sphere")


def torus(thickness=0.4):
    """A closed torus about z, of radius 1; its outward normal is away from the circle in its middle."""
    long, short = np.meshgrid(np.arange(60), np.arange(24), indexing="ij")
    u, v = 2.0 * np.pi * long / 60, 2.0 * np.pi * short / 24
    radius = 1.0 + thickness * np.cos(v)
    vertices = np.stack(
        [radius * np.cos(u), radius * np.sin(u), thickness * np.sin(v)], axis=-1
    ).reshape(-1, 3)
    at, right = 24 * long + short, 24 * ((long + 1) % 60) + short
    up, across = 24 * long + (short + 1) % 24, 24 * ((long + 1) % 60) + (short + 1) % 24
    halves = (at, right, across), (at, across, up)
    faces = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    return Shape.from_arrays(vertices, faces, name="torus")


def slab(thickness):
    """A box whose two large sides are that far apart, its corners shared, triangles outwards."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    return Shape.from_arrays(corners * [2.0, 3.0, thickness], faces, name="slab")


def outward_on_torus(points):
    middle = points * [1.0, 1.0, 0.0]
    away = points - middle / np.linalg.norm(middle, axis=1, keepdims=True)
    return away / np.linalg.norm(away, axis=1, keepdims=True)


@pytest.mark.parametrize(("num", "is_surface"), [(20, False), (150, False), (600, True)])
def test_planes_of_a_cloud_need_neighbours_that_are_near(num, is_surface):
    points = np.random.default_rng(num).standard_normal((num, 3))
    cloud = Shape.from_arrays(points / np.linalg.norm(points, axis=1, keepdims=True))
    assert (surface_cells(cloud, 0.12) is not None) == is_surface


def test_points_of_a_sphere_lie_a_cell_apart_with_normals_outwards():
    found = surface_cells(sphere(), 0.15)
    gaps = cKDTree(found.points).query(found.points, k=2)[0][:, 1]
    assert 0.4 < np.median(gaps) / 0.15 < 1.2
    assert 0.7 < len(found.points) * 0.15**2 / (4.0 * np.pi) < 2.5
    assert np.abs(np.linalg.norm(found.points, axis=1) - 1.0).max() < 0.02
    assert (np.einsum("la,la->l", found.points, found.normals) > 0.98).all()
    assert found.cell == 0.15
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0)
    assert len(surface_cells(sphere(), 0.3).points) < 0.4 * len(found.points)


def test_normals_of_a_mesh_point_outwards_where_it_is_hollow_and_when_it_is_inside_out():
    mesh = torus()
    for faces in (mesh.faces, mesh.faces[:, ::-1]):
        found = surface_cells(Shape.from_arrays(mesh.vertices, faces, name="torus"), 0.12)
        assert (np.einsum("la,la->l", outward_on_torus(found.points), found.normals) > 0.9).all()


@pytest.mark.parametrize("depth", [-0.05, 0.0, 0.05])
def test_an_open_mesh_that_is_nearly_flat_keeps_the_side_of_its_file(depth):
    x, y = (line.ravel() for line in np.meshgrid(*[np.linspace(-1.0, 1.0, 12)] * 2))
    corner = (12 * np.arange(11)[:, None] + np.arange(11)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + 13], 1),
            np.stack([corner, corner + 13, corner + 12], 1),
        ]
    )
    vertices = np.column_stack([x, y, depth * (x * x + y * y)])
    assert (spread_over_triangles(Shape.from_arrays(vertices, faces), 0.1)[1][:, 2] > 0.9).all()
    turned = Shape.from_arrays(vertices, faces[:, ::-1])
    assert (spread_over_triangles(turned, 0.1)[1][:, 2] < -0.9).all()


def test_both_sides_of_a_thin_wall_keep_points():
    found = surface_cells(slab(0.02), 0.2)
    for side in (1.0, -1.0):
        on_side = found.normals[:, 2] * side > 0.9
        assert on_side.sum() >= 0.8 * 2.0 * 3.0 / 0.2**2
        assert np.abs(found.points[on_side, 2] - (0.02 if side > 0 else 0.0)).max() < 1e-9


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_normals_of_a_cloud_point_outwards(share):
    mesh = torus()
    points = spread_over_triangles(mesh, 0.03)[0]
    points = points[points[:, 0] < np.quantile(points[:, 0], share)]
    found = surface_cells(Shape.from_arrays(points, name="cloud"), 0.12)
    assert (
        np.einsum("la,la->l", outward_on_torus(found.points), found.normals) > 0.7
    ).mean() > 0.98


def test_hardly_any_points_are_no_surface():
    line = Shape.from_arrays(np.linspace(0.0, 1.0, 50)[:, None] * [[1.0, 2.0, 3.0]], name="line")
    assert surface_cells(sphere(), 3.0) is None
    assert surface_cells(Shape.from_arrays(np.eye(3).repeat(4, axis=0), name="few"), 0.1) is None
    assert surface_cells(line, 0.5) is None


@pytest.mark.parametrize("num", [40, 2000])
def test_centre_and_radius_are_those_of_points_spread_by_area(num):
    shape = blob(np.random.default_rng(4), num_vertices=num)
    shape = Shape.from_arrays(
        shape.vertices + np.array([30.0, 0.0, -10.0]), shape.faces, name="far"
    )
    corners = shape.vertices[shape.faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(3), size=200_000)
    points = np.einsum(
        "nc,nca->na", weights, corners[rng.choice(len(corners), 200_000, p=areas / areas.sum())]
    )
    centre, radius = centre_and_radius(shape)
    np.testing.assert_allclose(centre, points.mean(axis=0), atol=0.01)
    assert radius == pytest.approx(
        np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()), rel=0.005
    )
    cloud = Shape.from_arrays(points, name="cloud")
    np.testing.assert_allclose(centre_and_radius(cloud)[0], points.mean(axis=0), atol=0.02)
    assert centre_and_radius(cloud)[1] == pytest.approx(radius, rel=0.03)
    uneven = Shape.from_arrays(
        np.concatenate([points, np.repeat(points[points[:, 0] > 30.0], 7, axis=0)]), name="u"
    )
    np.testing.assert_allclose(centre_and_radius(uneven)[0], centre_and_radius(cloud)[0], atol=0.03)


def test_only_open_surfaces_have_points_on_a_rim():
    closed, opened = spread_points(blob(np.random.default_rng(0)), 300), spread_points(crown(), 300)
    assert not closed.on_rim.any()
    assert 0.03 < opened.on_rim.mean() < 0.4
    lowest = opened.points[:, 2] < np.quantile(opened.points[:, 2], 0.02)
    assert opened.on_rim[lowest].all()


def test_a_clouds_rim_is_found_by_its_gaps():
    closed, opened = (
        Shape.from_arrays(s.vertices, name="c") for s in (blob(np.random.default_rng(2)), crown())
    )
    assert spread_points(closed, 300).on_rim.mean() < 0.05
    found = spread_points(opened, 300)
    lowest = found.points[:, 2] < np.quantile(found.points[:, 2], 0.03)
    assert found.on_rim[lowest].mean() > 0.7
    assert found.on_rim[~lowest].mean() < 0.25


def test_copies_of_points_and_points_without_normals_have_the_rim_of_single_ones():
    vertices = crown().vertices
    normals = plane_normals(vertices, vertices)
    rim = cloud_rim(vertices, normals)
    copied = cloud_rim(np.tile(vertices, (20, 1)), np.tile(normals, (20, 1)))
    np.testing.assert_array_equal(copied, np.tile(rim, 20))
    without = np.arange(len(vertices)) % 3 == 0
    found = cloud_rim(vertices, np.where(without[:, None], 0.0, normals))
    np.testing.assert_array_equal(found, rim)


def image_of_a_corner(rng, noise):
    """Return what a camera sees of the corner of a room, triangles towards it, and where the camera is."""
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 60), np.linspace(-0.6, 0.6, 60))
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    walls = np.array([[0.6, 0.5, 1.0], [-0.7, 0.4, 1.0], [0.0, -0.9, 1.0]])
    depths = (3.0 / np.maximum(rays @ walls.T, 0.1)).min(axis=1)
    vertices = rays * (depths + noise * rng.standard_normal(len(depths)))[:, None]
    at = (60 * np.arange(59)[:, None] + np.arange(59)).ravel()
    faces = np.concatenate(
        [np.stack([at, at + 61, at + 1], 1), np.stack([at, at + 60, at + 61], 1)]
    )
    return Shape.from_arrays(vertices, faces, name="corner")


def test_hollow_images_show_a_scene_and_bulging_ones_a_thing():
    room = surface_cells(image_of_a_corner(np.random.default_rng(0), 0.01), 0.1)
    thing = surface_cells(sphere(), 0.15)
    assert thing.bulge > 0.9
    assert shows_scene([room] * 3)
    assert shows_scene([room, room, thing])
    assert not shows_scene([room, thing, thing])
    assert not shows_scene([thing] * 3)
    assert not shows_scene([])
