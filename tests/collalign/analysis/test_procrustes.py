import numpy as np
import pytest
from scipy.spatial import procrustes
from scipy.spatial.transform import Rotation

from collalign.analysis.procrustes import (
    common_labels,
    generalized_procrustes,
    principal_components,
    procrustes_distances,
)
from data_tools.errors import InputError


def moved(shapes, rng):
    """The same shapes in other places, poses and sizes."""
    num = len(shapes)
    R = Rotation.random(num, random_state=int(rng.integers(2**31))).as_matrix()
    return rng.uniform(0.1, 10, (num, 1, 1)) * (
        shapes @ np.swapaxes(R, 1, 2)
    ) + rng.standard_normal((num, 1, 3))


def test_superimposition_undoes_similarities(rng):
    shape = rng.standard_normal((12, 3))
    found = generalized_procrustes(moved(np.tile(shape, (6, 1, 1)), rng))
    np.testing.assert_allclose(found, np.tile(found[0], (6, 1, 1)), atol=1e-9)
    assert np.linalg.norm(found[0]) == pytest.approx(1)


def test_components_of_a_planted_family(rng):
    base, axis = rng.standard_normal((2, 10, 3))
    axis /= np.linalg.norm(axis)
    scores = rng.standard_normal(30)
    found = principal_components(base + scores[:, None, None] * axis)
    assert found.shares[0] == pytest.approx(1)
    assert abs(float((found.axes[0] * axis).sum())) == pytest.approx(1)
    assert found.variances[0] == pytest.approx(scores.var(ddof=1))
    np.testing.assert_allclose(found.mean, base + scores.mean() * axis, atol=1e-12)
    np.testing.assert_allclose(
        found.shape_at(0, 2) - found.shape_at(0, -2), 4 * scores.std(ddof=1) * found.axes[0]
    )


def test_scores_and_axes_give_the_shapes_back(rng):
    shapes = rng.standard_normal((6, 9, 3))
    found = principal_components(shapes)
    assert found.scores.shape == (6, 5)
    np.testing.assert_allclose(
        found.mean + np.tensordot(found.scores, found.axes, 1), shapes, atol=1e-12
    )


def test_distance_is_scipy_s_disparity(rng):
    shapes = rng.standard_normal((2, 15, 3)) * 0.3 + rng.standard_normal((15, 3))
    disparity = procrustes(shapes[0], shapes[1])[2]  # the square of sin(rho)
    assert np.sin(2.0 * np.arcsin(procrustes_distances(shapes)[0, 1] / 2.0)) ** 2 == pytest.approx(
        disparity
    )


def test_distances_use_the_labels_that_two_shapes_share(rng):
    shapes = rng.standard_normal((3, 10, 3))
    partial = shapes.copy()
    partial[0, :4] = np.nan
    partial[2, :8] = np.nan
    found = procrustes_distances(partial)
    assert found[0, 1] == pytest.approx(procrustes_distances(shapes[:2, 4:])[0, 1])
    assert np.isnan(found[0, 2])
    assert np.isnan(found[1, 2])
    assert (np.diag(found) == 0).all()
    np.testing.assert_array_equal(common_labels(partial[:2]), [False] * 4 + [True] * 6)


def test_bad_input_is_refused(rng):
    with pytest.raises(InputError, match="NaN"):
        generalized_procrustes(np.full((2, 5, 3), np.nan))
    with pytest.raises(InputError, match="single point"):
        generalized_procrustes(np.ones((2, 5, 3)))
    with pytest.raises(InputError, match="no shapes"):
        generalized_procrustes(np.ones((0, 5, 3)))
    with pytest.raises(InputError, match="at least two"):
        principal_components(np.ones((1, 5, 3)))
    with pytest.raises(InputError, match="expected shape"):
        procrustes_distances(np.ones((5, 3)))
