import numpy as np
import pytest
from scipy.spatial import procrustes

from collalign.analysis.procrustes import (
    common_labels,
    generalized_procrustes,
    principal_components,
    procrustes_distances,
)
from data_tools.errors import InputError


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
