"""Descriptors of neighbourhoods: the published histograms, which poses leave and mirroring reverses."""

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.local_surface import MOST_COMPARED, NUM_BINS, LocalSurface, fast_point_features
from data_tools.rotations import random_rotation


def bumpy(num=80):
    """Points on a bumpy ellipsoid and unit vectors near its normals."""
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((num, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = directions + 0.3 * rng.standard_normal((num, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return directions * [1.0, 0.8, 0.6] * rng.uniform(0.9, 1.1, (num, 1)), normals


def bins_of(angles):
    return [min(int((angle + 1.0) * NUM_BINS / 2.0), NUM_BINS - 1) for angle in angles]


def plain_histograms(points, normals, radius):
    """The histograms as Rusu, Blodow and Beetz (2009) write them, point by point."""
    simple, near = np.zeros((len(points), 3, NUM_BINS)), []
    for i, (point, u) in enumerate(zip(points, normals, strict=True)):
        gaps = np.linalg.norm(points - point, axis=1)
        near.append([(j, gaps[j]) for j in range(len(points)) if j != i and gaps[j] <= radius])
        for j, gap in near[i]:
            arm = (points[j] - point) / gap
            v = np.cross(arm, u)
            v /= np.linalg.norm(v)
            w = np.cross(u, v)
            theta = np.arctan2(w @ normals[j], u @ normals[j]) / np.pi
            for row, place in enumerate(bins_of([v @ normals[j], u @ arm, theta])):
                simple[i, row, place] += 1.0 / (3.0 * len(near[i]))
    spread = simple.copy()
    for i, others in enumerate(near):
        total = sum(1.0 / gap for _, gap in others)
        spread[i] = 0.5 * (simple[i] + sum(simple[j] / gap for j, gap in others) / total)
    return spread.reshape(len(points), 3 * NUM_BINS)


def test_histograms_are_the_published_ones():
    points, normals = bumpy()
    found = fast_point_features(points, normals, 0.7)
    np.testing.assert_allclose(found, plain_histograms(points, normals, 0.7), atol=1e-12)
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    assert np.abs(found - plain_histograms(points, normals, 0.6)).max() > 0.01


def test_a_point_without_neighbours_has_an_empty_histogram():
    points, normals = bumpy(30)
    points[0] += 100.0
    found = fast_point_features(points, normals, 0.9)
    assert not found[0].any()
    assert np.isfinite(found).all()


def test_poses_leave_histograms_and_units_of_length_too():
    points, normals = bumpy()
    turn = random_rotation(np.random.default_rng(5))
    found = fast_point_features(points, normals, 0.7)
    moved = fast_point_features(7.0 * points @ turn.T + [1.0, 2.0, 3.0], normals @ turn.T, 4.9)
    np.testing.assert_allclose(moved, found, atol=1e-9)
    assert np.abs(fast_point_features(points, -normals, 0.7) - found).max() > 0.01


def test_a_mirrored_surface_has_the_descriptors_of_the_mirrored_points():
    points, normals = bumpy()
    flip = np.array([-1.0, 1.0, 1.0])
    surface = LocalSurface.from_user(points, normals, 0.14)
    mirrored, again = (
        surface.mirrored(),
        LocalSurface.from_user(points * flip, normals * flip, 0.14),
    )
    np.testing.assert_array_equal(mirrored.points, again.points)
    np.testing.assert_array_equal(mirrored.normals, again.normals)
    np.testing.assert_allclose(mirrored.features, again.features, atol=1e-6)
    assert np.abs(mirrored.features - surface.features).max() > 0.05
    np.testing.assert_array_equal(mirrored.mirrored().histograms, surface.histograms)


def test_descriptors_are_unit_vectors_near_the_roots_of_the_histograms():
    points, normals = bumpy()
    surface = LocalSurface.from_user(points, normals, 0.14)
    np.testing.assert_allclose(np.linalg.norm(surface.features, axis=1), 1.0, atol=1e-5)
    roots = np.sqrt(fast_point_features(points, normals, 0.7))
    np.testing.assert_allclose(surface.features, roots, atol=0.006)


def test_large_surfaces_are_compared_at_an_even_choice():
    for num, compared in (
        (MOST_COMPARED, MOST_COMPARED),
        (MOST_COMPARED + 1, MOST_COMPARED // 2 + 1),
    ):
        points, normals = bumpy(num)
        assert len(points[LocalSurface.from_user(points, normals, 0.05).few()]) == compared


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


def test_the_other_side_of_a_surface_is_described_without_looking_again():
    points, normals = bumpy()
    surface = LocalSurface.from_user(points, normals, 0.15)
    turned = surface.reversed()
    again = LocalSurface.from_user(points, -normals, 0.15)
    np.testing.assert_array_equal(turned.normals, -normals)
    np.testing.assert_allclose(turned.histograms.astype(int), again.histograms.astype(int), atol=1)
    assert np.abs(turned.histograms.astype(int) - surface.histograms.astype(int)).max() > 10
