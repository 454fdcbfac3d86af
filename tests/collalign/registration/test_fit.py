"""Fitted surfaces: exact maps give the truth, scattered ones a surface nearer to it that lies on the target."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from collalign.registration.by_map import bent_by_map, fitted_by_map
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape
from tests.finished_runs import radius

FIGURE = figure(resolution=2)
BENT = bent(FIGURE, np.random.default_rng(1), angle=1.0).vertices


def errors(found, truth):
    return np.asarray(np.linalg.norm(found - truth, axis=1) / radius(truth))


def every(places):
    return np.arange(len(places)), places


def with_faces(vertices):
    return Shape.from_arrays(vertices, FIGURE.faces)


def scattered(truth, rng, *, by):
    """Return goals on the truth's vertices: those nearest to scattered places, a twentieth anywhere."""
    noisy = truth + by * radius(truth) * rng.standard_normal(truth.shape)
    wrong = rng.random(len(truth)) < 0.05
    noisy[wrong] = truth[rng.integers(len(truth), size=int(wrong.sum()))]
    return truth[cKDTree(truth).query(noisy)[1]]


def test_an_exact_map_gives_the_bent_figure_itself_but_for_its_tips():
    found = errors(fitted_by_map(with_faces(BENT), FIGURE, every(BENT)), BENT)
    assert np.median(found) < 0.002
    assert found.mean() < 0.02
    assert errors(FIGURE.vertices, BENT).mean() > 0.1


@pytest.fixture(scope="module")
def fitted():
    """Scattered goals of a map, and the figure fitted by it."""
    goals = scattered(BENT, np.random.default_rng(3), by=0.03)
    return goals, fitted_by_map(with_faces(BENT), FIGURE, every(goals))


def test_a_scattered_map_is_improved_and_the_figure_comes_to_lie_on_the_target(fitted):
    goals, found = fitted
    smoothed = bent_by_map(with_faces(BENT), FIGURE, every(goals))
    assert smoothed is not None
    assert errors(found, BENT).mean() < 0.1 * errors(goals, BENT).mean()
    gaps = [
        errors(SurfaceLocator(BENT, FIGURE.faces).closest(at).on(BENT), at).mean()
        for at in (found, smoothed)
    ]
    assert gaps[0] < 0.35 * gaps[1]


def test_poses_and_sizes_do_not_matter(fitted):
    goals, found = fitted
    turn = Rotation.from_euler("xyz", [170.0, 40.0, -80.0], degrees=True).as_matrix()
    moved = 3.0 * BENT @ turn.T + 7.0
    again = fitted_by_map(with_faces(moved), FIGURE, every(3.0 * goals @ turn.T + 7.0))
    assert errors(again, 3.0 * found @ turn.T + 7.0).max() < 1e-6


def test_a_stretched_target_keeps_the_places_of_its_map():
    stretched = BENT * [1.0, 2.5, 0.6]
    found = fitted_by_map(with_faces(stretched), FIGURE, every(stretched))
    assert np.median(errors(found, stretched)) < 0.01
