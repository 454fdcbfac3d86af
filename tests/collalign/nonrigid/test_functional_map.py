"""Functional maps: nearest rows by brute force, ICP and ZoomOut repair perturbed maps, bad input is refused."""

import numpy as np
import pytest

from collalign.nonrigid.functional_map import (
    ZoomOut,
    fitted_map,
    mutual_nearest_rows,
    zoomout_sizes,
)
from data_tools.errors import InputError, OptionsError


def circle_basis(angles, num):
    """The constant function and the eigenfunctions of a circle, lowest first."""
    columns = [np.ones(len(angles))]
    for k in range(1, num // 2 + 1):
        columns += [np.sqrt(2) * np.cos(k * angles), np.sqrt(2) * np.sin(k * angles)]
    return np.column_stack(columns)[:, :num]


def turns(angles):
    return np.abs((angles + np.pi) % (2 * np.pi) - np.pi)


def test_nearest_rows_agree_with_brute_force(rng):
    points, queries = rng.random((300, 7)), rng.random((411, 7))
    distances = np.linalg.norm(queries[:, None] - points, axis=2)
    assert np.array_equal(mutual_nearest_rows(points, queries)[0], distances.argmin(axis=1))
    forward, backward = mutual_nearest_rows(points, queries)
    assert np.array_equal(forward, distances.argmin(axis=1))
    assert np.array_equal(backward, distances.argmin(axis=0))


@pytest.mark.parametrize("num_functions", [6, 60])
def test_a_fitted_map_is_that_of_least_squares_over_both_directions(rng, num_functions):
    target, source = rng.standard_normal((2, 400, num_functions))
    forward, backward = rng.integers(-1, 400, (2, 400))
    known, back = forward >= 0, backward >= 0
    rows = np.concatenate([source[known], source[backward[back]]])
    images = np.concatenate([target[forward[known]], target[back]])
    expected = np.linalg.lstsq(rows, images)[0]
    assert np.allclose(fitted_map(target, source, forward, backward), expected, atol=1e-7)


def test_zoomout_repairs_a_bad_map_and_both_directions_agree(rng):
    angles = np.sort(rng.uniform(0, 2 * np.pi, 400))
    shift = 1.1
    target, source = circle_basis(angles, 41), circle_basis(angles - shift, 41)
    truth = np.arange(400)
    start = np.where(rng.random(400) < 0.3, rng.integers(0, 400, 400), truth)
    refined = ZoomOut(target, source, zoomout_sizes(5, 41)).refine(start)
    assert turns(angles[refined.map_target_source] - angles).max() < 0.15
    assert turns(angles[refined.map_source_target] - angles).max() < 0.15
    assert turns(angles[start] - angles).max() > 1.0
    exact = ZoomOut(target, source, [41]).refine(truth)
    assert np.array_equal(exact.map_target_source, truth)
    assert np.array_equal(mutual_nearest_rows(target, source @ exact.C_source_target)[0], truth)
    assert source @ exact.C_source_target == pytest.approx(target, abs=1e-4)


def test_wrong_input_is_refused(rng):
    basis = rng.random((20, 9))
    with pytest.raises(OptionsError, match="ascending"):
        ZoomOut(basis, basis, [5, 4])
    with pytest.raises(OptionsError, match="first <= last"):
        zoomout_sizes(9, 5)
    with pytest.raises(InputError, match="10 functions"):
        ZoomOut(basis, basis, [5, 10])
    with pytest.raises(InputError, match="too few"):
        ZoomOut(basis[:8], basis[:8], [9])
