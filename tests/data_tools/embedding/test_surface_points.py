"""Surfaces as points: what is a rim, and normals with and without signs."""

import numpy as np

from data_tools.datasets.synthetic_shapes import blob, crown
from data_tools.embedding.surface_points import RIM_NEIGHBOURS, cloud_rim, spread_points
from data_tools.surface.shape import Shape


def test_only_open_surfaces_have_points_on_a_rim():
    closed, opened = spread_points(blob(np.random.default_rng(0)), 300), spread_points(crown(), 300)
    assert not closed.on_rim.any()
    assert 0.03 < opened.on_rim.mean() < 0.4
    lowest = opened.points[:, 2] < np.quantile(opened.points[:, 2], 0.02)
    assert opened.on_rim[lowest].all()


def test_planes_of_a_cloud_agree_with_the_mesh_but_for_their_sign():
    mesh = blob(np.random.default_rng(1))
    known, fitted = (
        spread_points(mesh, 300),
        spread_points(Shape.from_arrays(mesh.vertices, name="cloud"), 300),
    )
    assert known.oriented
    assert not fitted.oriented
    np.testing.assert_array_equal(known.points, fitted.points)
    agreement = np.abs((known.normals * fitted.normals).sum(axis=1))
    assert np.median(agreement) > 0.98


def test_a_clouds_rim_is_found_by_its_gaps():
    closed, opened = (
        Shape.from_arrays(s.vertices, name="c") for s in (blob(np.random.default_rng(2)), crown())
    )
    assert spread_points(closed, 300).on_rim.mean() < 0.05
    found = spread_points(opened, 300)
    lowest = found.points[:, 2] < np.quantile(found.points[:, 2], 0.03)
    assert found.on_rim[lowest].mean() > 0.7
    assert found.on_rim[~lowest].mean() < 0.25


def test_the_neighbours_that_count_for_a_rim_are_just_the_nearest():
    angles = np.deg2rad([150.0, 210.0, *np.linspace(-90.0, 90.0, RIM_NEIGHBOURS - 2)])
    radii = np.where(np.arange(RIM_NEIGHBOURS) < 2, 2.0, 1.0)  # the farthest close the gap
    ring = np.column_stack(
        [radii * np.cos(angles), radii * np.sin(angles), np.zeros(RIM_NEIGHBOURS)]
    )
    cloud, upwards = (
        np.vstack([np.zeros(3), ring]),
        np.tile([0.0, 0.0, 1.0], (1 + RIM_NEIGHBOURS, 1)),
    )
    assert not cloud_rim(cloud, upwards)[0]
    assert cloud_rim(np.delete(cloud, 1, axis=0), upwards[1:])[0]
    assert cloud_rim(
        np.vstack([cloud, 0.5 * ring[2:4]]), np.tile(upwards[0], (3 + RIM_NEIGHBOURS, 1))
    )[0]
