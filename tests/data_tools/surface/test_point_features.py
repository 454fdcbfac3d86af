"""Histograms of neighbourhoods: the published ones, which poses leave."""

import numpy as np

from data_tools.local_surface import NUM_BINS
from data_tools.surface.point_features import fast_point_features
from tests.neighbourhoods import bumpy


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
    found = fast_point_features(points, normals, 0.7, NUM_BINS)
    np.testing.assert_allclose(found, plain_histograms(points, normals, 0.7), atol=1e-12)
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    assert np.abs(found - plain_histograms(points, normals, 0.6)).max() > 0.01
