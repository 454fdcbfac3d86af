"""Radii hold as often as they say where errors are as the theory assumes, and fusion follows its weights."""

import numpy as np

from collalign.confidence.radius_model import (
    COVERAGE,
    MIN_TEMPLATES,
    RadiusEvidence,
    beyond_range,
    calibrate,
    radii,
    spread,
)
from collalign.landmarks.carry import carried, on_surface, template
from collalign.landmarks.fusion import fuse, template_distance, template_weights
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.surface.closest import SurfaceLocator


def shown(num=30, distance=1.0, residual=1.0):
    """Return evidence of templates that agree."""
    return RadiusEvidence(spread=np.zeros(num), distance=distance, residual=np.full(num, residual), unit=1.0)


def simulated(rng, num):
    """Return errors of landmarks of very different difficulty, shape (num, 30)."""
    return np.abs(rng.standard_normal((num, 30))) * np.geomspace(0.05, 2, 30)


def test_nine_of_ten_new_landmarks_lie_within_their_radius():
    rng = np.random.default_rng(0)
    inside = []
    for _ in range(40):
        errors = simulated(rng, 8)
        calibration = calibrate(errors, [shown()] * len(errors))
        inside.append(simulated(rng, 40) <= radii(calibration, shown()))
    assert abs(np.mean(inside) - COVERAGE) < 0.03


def test_radii_tell_hard_landmarks_from_easy_ones():
    errors = simulated(np.random.default_rng(1), 8)
    radius = radii(calibrate(errors, [shown()] * len(errors)), shown())
    assert np.corrcoef(np.log(radius), np.arange(30))[0, 1] > 0.9


def test_a_wrong_scale_would_be_noticed():
    """The check of the coverage fails for radii that are too small by half."""
    rng = np.random.default_rng(2)
    errors = simulated(rng, 8)
    radius = radii(calibrate(errors, [shown()] * len(errors)), shown())
    assert np.mean(simulated(rng, 400) <= 0.5 * radius) < COVERAGE - 0.1


def test_specimens_unlike_the_templates_and_bad_fits_get_larger_radii():
    errors = simulated(np.random.default_rng(5), 8)
    calibration = calibrate(errors, [shown()] * 8)
    plain = radii(calibration, shown())
    for evidence in (shown(distance=2.0), shown(residual=2.0)):
        assert (radii(calibration, evidence) > 1.05 * plain).all()
    split = RadiusEvidence(spread=np.full(30, 5.0), distance=1.0, residual=np.ones(30), unit=1.0)
    assert (radii(calibration, split) > plain).all()


def test_few_templates_have_wider_radii_the_fewer_and_the_farther_they_are_and_none_has_none():
    errors = simulated(np.random.default_rng(3), MIN_TEMPLATES - 1)
    few = [calibrate(errors[:num], [shown()] * num) for num in range(MIN_TEMPLATES)]
    assert np.isnan(radii(few[0], shown())).all()
    sizes = [radii(one, shown(distance=0.2)) for one in few[1:]]
    assert (np.diff(sizes, axis=0) < 0).all()
    np.testing.assert_allclose(radii(few[1], shown(distance=0.4)), 2 * sizes[0])
    split = RadiusEvidence(spread=np.ones(30), distance=0.2, residual=np.ones(30), unit=1.0)
    assert (radii(few[2], split) > sizes[1]).all()
    assert (radii(few[1], shown(distance=0.0)) > 0).all()


def test_missing_landmarks_count_for_nothing():
    errors = simulated(np.random.default_rng(4), 8)
    errors[2, 5] = np.nan
    errors[:, 7] = np.nan
    radius = radii(calibrate(errors, [shown()] * len(errors)), shown())
    assert np.isnan(radius[7])
    assert np.isfinite(np.delete(radius, 7)).all()


def test_the_spread_is_the_weighted_standard_deviation():
    said = np.array([[[0.0, 0, 0]], [[1.0, 0, 0]], [[np.nan] * 3]])
    assert np.isclose(spread(said, np.array([[0.5], [0.5], [0.0]]))[0], 0.5)
    assert np.isclose(spread(said, np.array([[1.0], [0.0], [0.0]]))[0], 0.0)


def test_templates_nearer_to_the_specimen_count_more():
    mean, faces = sphere_mesh(200)
    vertices = np.stack([mean, 1.1 * mean, 1.5 * mean])
    marks = mean[[3, 50]]
    templates = [template(0, marks, vertices[0], faces, 1.0), template(2, 1.5 * marks, vertices[2], faces, 1.0)]
    weights = template_weights(templates, 1, vertices, np.ones((3, 200)))
    assert (weights[0] > weights[1]).all()
    np.testing.assert_allclose(weights.sum(axis=0), 1)
    assert 0 < template_distance(templates, 1, vertices) < template_distance(templates[1:], 1, vertices)
    points, spreads = fuse(templates, 1, vertices, np.ones((3, 200)))
    np.testing.assert_allclose(points, 1.1 * marks, atol=1e-9)
    np.testing.assert_allclose(spreads, 0, atol=1e-6)


def test_a_landmark_inside_keeps_its_offset_and_one_on_the_surface_is_put_there():
    mean, faces = sphere_mesh(200)
    marks = np.stack([0.5 * mean[7], 1.01 * mean[9], [np.nan] * 3])
    found = template(0, marks, mean, faces, 1.0)
    on_sphere = on_surface(carried([found], mean)[0], [found], SurfaceLocator(mean, faces))
    np.testing.assert_allclose(on_sphere[0], marks[0], atol=1e-9)
    np.testing.assert_allclose(on_sphere[1], mean[9], atol=1e-6)
    assert np.isnan(on_sphere[2]).all()
    assert (template_weights([found], 0, mean[None], np.ones((1, 200)))[:, 2] == 0).all()


def test_a_fit_worse_than_on_any_template_is_out_of_range():
    errors = simulated(np.random.default_rng(6), 8)
    calibration = calibrate(errors, [shown(residual=0.05)] * 8)
    bad = shown(residual=0.05)
    bad.residual[4] = 0.3
    assert beyond_range(calibration, bad).tolist() == [at == 4 for at in range(30)]
    assert not beyond_range(calibration, shown(residual=0.05)).any()
    rough = calibrate(errors, [shown(residual=0.2)] * 8)
    assert not beyond_range(rough, shown(residual=0.15)).any()
    few = calibrate(errors[:2], [shown(residual=0.05)] * 2)
    assert not beyond_range(few, bad).any()
