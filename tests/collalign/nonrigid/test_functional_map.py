"""Functional maps: nearest rows by brute force, ICP and ZoomOut repair perturbed maps, bad input is refused."""

import numpy as np
import pytest

from collalign.nonrigid.functional_map import ZoomOut, mutual_nearest_rows, zoomout_sizes
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


def test_maps_that_are_screened_together_are_those_of_one_by_one_the_best_first(rng):
    angles = np.sort(rng.uniform(0, 2 * np.pi, 60))
    target, source = circle_basis(angles, 9), circle_basis(angles - 0.7, 9)
    curved = np.cos(angles)[:, None] + [0.1, 0.4]
    zoomout = ZoomOut(target, source, [5, 9], descriptors=(curved, curved))
    truth = np.arange(60)
    starts = [
        (start, start[::-1])
        for start in (rng.integers(0, 60, 60), np.roll(truth, 20), rng.integers(0, 60, 60))
    ] + [(truth, truth)]
    found = zoomout.screen(starts)
    alone = [zoomout.refine(*start).map_target_source.tolist() for start in starts]
    assert sorted(one.map_target_source.tolist() for _, one in found) == sorted(alone)
    gaps = [gap for gap, _ in found]
    assert gaps == sorted(gaps)
    assert gaps[0] < 0.01 < gaps[-1]
    assert found[0][1].map_target_source.tolist() == truth.tolist()


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
