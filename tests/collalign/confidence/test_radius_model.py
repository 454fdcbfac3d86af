"""Radii hold as often as they say where errors are as the theory assumes, and fusion follows its weights."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.confidence.radius_model import (
    COVERAGE,
    RadiusEvidence,
    beyond_range,
    calibrate,
    ellipsoids,
    radii,
    spread,
)
from collalign.template_landmarks.carry import (
    carried,
    fuse,
    mean_of_trusted,
    on_surface,
    template,
    template_distance,
    template_weights,
)
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.surface.closest import SurfaceLocator


def shown(
    num=30,
    distance=1.0,
    residual=1.0,
    hold=0.01,
    slip=0.2,
    misfit=0.05,
    spread=0.0,
    unit=1.0,
    variation=1.0,
    held=(0.1, 0.2, 0.7),
    held_slip=0.02,
):
    """Return evidence of templates that agree."""
    return RadiusEvidence(
        spread=np.full(num, spread),
        distance=distance,
        residual=np.full(num, residual),
        unit=unit,
        variation=variation,
        hold=np.full(num, hold),
        slip=np.full(num, slip),
        misfit=np.full(num, misfit),
        held=np.repeat(np.diag(held)[None], num, axis=0),
        held_slip=np.full(num, held_slip),
    )


def simulated(rng, num):
    """Return errors of landmarks of very different difficulty, shape (num, 30)."""
    return np.abs(rng.standard_normal((num, 30))) * np.geomspace(0.05, 2, 30)


def test_nine_of_ten_new_landmarks_lie_within_their_radius():
    rng = np.random.default_rng(0)
    inside, too_small = [], []
    for _ in range(40):
        errors = simulated(rng, 8)
        radius, new = radii(calibrate(errors, [shown()] * len(errors)), shown()), simulated(rng, 40)
        inside.append(new <= radius)
        too_small.append(new <= 0.5 * radius)
    assert abs(np.mean(inside) - COVERAGE) < 0.03
    assert np.mean(too_small) < COVERAGE - 0.1, "the check notices radii that are too small by half"


def test_specimens_unlike_the_templates_and_bad_fits_get_larger_radii():
    errors = simulated(np.random.default_rng(5), 8)
    calibration = calibrate(errors, [shown()] * 8)
    plain = radii(calibration, shown())
    for evidence in (shown(distance=2.0), shown(residual=2.0)):
        assert (radii(calibration, evidence) > 1.05 * plain).all()
    assert (radii(calibration, shown(spread=5.0)) > plain).all()


@pytest.mark.parametrize("num", [1, 2, 3])
def test_radii_of_few_templates_follow_the_surface_and_the_spread_and_have_a_unit(num):
    calibration = calibrate(simulated(np.random.default_rng(3), num), [shown()] * num)
    plain = radii(calibration, shown())
    for worse in (shown(slip=0.8), shown(hold=0.001), shown(misfit=0.2), shown(variation=2.0)):
        assert (radii(calibration, worse) > plain).all()
    assert ((radii(calibration, shown(spread=0.3)) > plain) == (num > 1)).all()
    np.testing.assert_allclose(
        radii(calibration, shown(slip=2.0, misfit=0.5, unit=10.0, variation=10.0)), 10 * plain
    )
    assert (radii(calibration, shown(slip=0.0, misfit=0.0, variation=0.0)) > 0).all()


def test_without_templates_there_are_no_radii():
    nothing = calibrate(np.empty((0, 30)), [])
    assert np.isnan(radii(nothing, shown())).all()
    assert np.isnan(ellipsoids(nothing, shown())).all()


def inside(errors, axes):
    """Return which errors (m, 3) lie in an ellipsoid of these semi-axes, rows of (3, 3)."""
    lengths = np.linalg.norm(axes, axis=1)
    return (((errors @ (axes / lengths[:, None]).T) / lengths) ** 2).sum(axis=1) <= 1


def test_nine_of_ten_errors_that_slide_lie_in_ellipsoids_much_smaller_than_their_radii():
    """Errors are far along the direction in which the surface tells the place least."""
    rng, held = np.random.default_rng(7), np.array([0.1, 0.4, 1.0])
    evidence, within, sizes = shown(held=held), [], []
    for _ in range(20):
        errors = rng.standard_normal((8, 30, 3)) / held
        lengths = np.linalg.norm(errors, axis=2)
        of_held = calibrate(np.array([evidence.held_errors(one) for one in errors]), [evidence] * 8)
        axes = ellipsoids(of_held, evidence)
        new = rng.standard_normal((200, 3)) / held
        within.append(inside(new, axes[3]))
        radius = radii(calibrate(lengths, [evidence] * 8), evidence)
        sizes.append(np.prod(np.linalg.norm(axes[3], axis=1)) ** (1 / 3) / radius[3])
    assert abs(np.mean(within) - COVERAGE) < 0.04
    assert np.mean(sizes) < 0.5
    assert not inside(new, 0.5 * axes[3]).mean() > 0.8, "the check notices ones that are too small"


@pytest.mark.parametrize("num", [1, 2, 3])
def test_ellipsoids_of_few_templates_follow_slip_and_hold_and_have_a_unit(num):
    calibration = calibrate(simulated(np.random.default_rng(3), num), [shown()] * num)
    lengths = np.linalg.norm(ellipsoids(calibration, shown()), axis=2)
    np.testing.assert_allclose(lengths[:, 0] / lengths[:, 2], 7.0)
    np.testing.assert_allclose(
        np.abs(ellipsoids(calibration, shown())[0, 0]), [lengths[0, 0], 0, 0]
    )
    assert (np.diff(lengths, axis=1) < 0).all(), "longest first"
    for worse in (shown(held_slip=0.04), shown(misfit=0.2), shown(variation=2.0)):
        more = np.linalg.norm(ellipsoids(calibration, worse), axis=2)
        assert (more > lengths).all()
        ratios = more / lengths
        np.testing.assert_allclose(ratios, ratios[0, 0])
    apart = np.linalg.norm(ellipsoids(calibration, shown(spread=0.3)), axis=2)
    assert ((apart > lengths) == (num > 1)).all()
    same = shown(held_slip=0.2, misfit=0.5, unit=10.0, variation=10.0)
    np.testing.assert_allclose(np.linalg.norm(ellipsoids(calibration, same), axis=2), 10 * lengths)
    assert (ellipsoids(calibration, shown(held_slip=0.0)) ** 2).sum() > 0


def test_the_spread_is_the_weighted_standard_deviation():
    said = np.array([[[0.0, 0, 0]], [[1.0, 0, 0]], [[np.nan] * 3]])
    assert np.isclose(spread(said, np.array([[0.5], [0.5], [0.0]]))[0], 0.5)
    assert np.isclose(spread(said, np.array([[1.0], [0.0], [0.0]]))[0], 0.0)


def test_templates_nearer_to_the_specimen_count_more():
    mean, faces = sphere_mesh(200)
    vertices = np.stack([mean, 1.1 * mean, 1.5 * mean])
    marks = mean[[3, 50]]
    templates = [
        template(0, marks, vertices[0], faces, 1.0, SurfaceLocator(vertices[0], faces)),
        template(2, 1.5 * marks, vertices[2], faces, 1.0, SurfaceLocator(vertices[2], faces)),
    ]
    weights = template_weights(templates, 1, vertices, np.ones((3, 200)))
    assert (weights[0] > weights[1]).all()
    np.testing.assert_allclose(weights.sum(axis=0), 1)
    assert (
        0
        < template_distance(templates, 1, vertices)
        < template_distance(templates[1:], 1, vertices)
    )
    points, spreads = fuse(carried(templates, vertices[1]), weights)
    np.testing.assert_allclose(points, 1.1 * marks, atol=1e-9)
    np.testing.assert_allclose(spreads, 0, atol=1e-6)


def test_a_template_that_is_not_trusted_counts_where_no_other_is():
    mean, faces = sphere_mesh(200)
    marks = mean[[3, 50, 70]]
    vertices, quality = np.stack([mean, 1.1 * mean, 1.2 * mean]), np.ones((3, 200))
    first, second = (
        template(at, (1 + 0.1 * at) * marks, vertices[at], faces, 1.0, SurfaceLocator(mean, faces))
        for at in (0, 2)
    )
    first = replace(first, trust=np.array([0.0, 0.0, 1.0]))
    second = replace(second, trust=np.array([1.0, 0.0, 0.5]))
    weights = template_weights([first, second], 1, vertices, quality)
    equal = template_weights(
        [replace(one, trust=np.ones(3)) for one in (first, second)], 1, vertices, quality
    )
    assert weights[:, 0].tolist() == [0, 1]
    np.testing.assert_allclose(weights[:, 1], equal[:, 1])
    assert weights[1, 2] < equal[1, 2]
    values = np.array([[1.0, 1.0, 1.0], [3.0, 3.0, 4.0]])
    np.testing.assert_allclose(mean_of_trusted([first, second], values), [3.0, 2.0, 2.0])


def test_a_landmark_inside_keeps_its_offset_and_one_on_the_surface_is_put_there():
    mean, faces = sphere_mesh(200)
    marks = np.stack([0.5 * mean[7], 1.01 * mean[9], [np.nan] * 3])
    found = template(0, marks, mean, faces, 1.0, SurfaceLocator(mean, faces))
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
