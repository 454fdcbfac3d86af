"""Surfaces bent by maps: exact maps give the truth back, partly wrong ones nearly, others are not believed."""

import numpy as np
from scipy.spatial.transform import Rotation

from collalign.registration.by_map import bent_by_map, unbent
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.poses import fitting_similarity, moved_by
from data_tools.surface.shape import Shape
from tests.collalign.registration.test_fit import errors, every
from tests.finished_runs import radius

FIGURE = figure(resolution=2)


def turn_by(angle_deg):
    return np.asarray(Rotation.from_euler("z", angle_deg, degrees=True).as_matrix())


def started(truth, goals):
    """Return the figure bent by goals; it has to be believed."""
    found = bent_by_map(Shape.from_arrays(truth, FIGURE.faces), FIGURE, goals)
    assert found is not None
    return found


def test_a_small_turn_and_a_size_are_found_exactly_and_nearly_from_scattered_goals():
    rng = np.random.default_rng(0)
    truth = 3.0 * FIGURE.vertices @ turn_by(20.0).T + rng.random(3)
    np.testing.assert_allclose(started(truth, every(truth)), truth, atol=1e-3)
    scattered = truth + 0.05 * radius(truth) * rng.standard_normal(truth.shape)
    assert (
        errors(started(truth, every(scattered)), truth).mean()
        < 0.4 * errors(scattered, truth).mean()
    )


def test_a_map_without_order_is_not_believed():
    for seed in range(4):  # of these, the third turns little
        order = np.random.default_rng(seed).permutation(len(FIGURE.vertices))
        assert bent_by_map(FIGURE, FIGURE, every(FIGURE.vertices[order])) is None


def test_maps_of_a_part_and_maps_against_the_pose_are_not_believed():
    few = np.arange(10), FIGURE.vertices[:10]
    assert bent_by_map(FIGURE, FIGURE, few) is None
    for angle, is_believed in ((50.0, True), (70.0, False), (180.0, False)):
        turned = Shape.from_arrays(FIGURE.vertices @ turn_by(angle).T, FIGURE.faces)
        assert (bent_by_map(turned, FIGURE, every(turned.vertices)) is not None) == is_believed


def test_unbent_copies_have_the_posture_of_the_source_and_their_own_lengths():
    rng = np.random.default_rng(4)
    thick = Shape.from_arrays(FIGURE.vertices * [1.0, 1.5, 1.0], FIGURE.faces)
    copies = [bent(thick, rng, angle=1.0).vertices for _ in range(2)]
    for copy, found in zip(copies, unbent(FIGURE, copies), strict=True):
        assert unlikeness(found, thick.vertices) < 0.5 * unlikeness(copy, thick.vertices)
        areas = [
            Shape.from_arrays(points, FIGURE.faces).area
            for points in (found, copy, FIGURE.vertices)
        ]
        assert abs(areas[0] / areas[1] - 1.0) < 0.05 < areas[1] / areas[2] - 1.0
    np.testing.assert_allclose(unbent(FIGURE, [FIGURE.vertices])[0], FIGURE.vertices, atol=1e-6)


def unlikeness(one, other):
    """Return how far two surfaces are from each other once moved, turned and scaled, in radii."""
    pose = fitting_similarity(other, one, np.ones(len(one)))
    return float(errors(moved_by(pose, one), other).mean())
