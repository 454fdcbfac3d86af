"""Consistent labels, generalised Procrustes analysis, and the paper's alternation of assignments and rotations."""

import numpy as np
import pytest

from collalign.stages.poses.placement import common_scales
from collalign.synchronization import (
    alternate_assignments,
    synchronize_maps,
    synchronize_permutations,
)
from collalign.synchronization.spectral import assign_all_pairs
from data_tools.errors import InputError, OptionsError
from tests.synchronization_problems import complete_edges, random_rotations, regular_edges

SPARSE = regular_edges(30, 10, 0)


def _planted(rng, num_shapes, num, edges, wrong):
    """Labels, maps in which a share of the matches is permuted at random, and samples at the labels' places."""
    labels = np.stack([rng.permutation(num) for _ in range(num_shapes)])
    maps = np.stack([np.argsort(labels[i])[labels[j]] for i, j in edges])
    for row in maps:
        spoiled = np.flatnonzero(rng.random(num) < wrong)
        row[spoiled] = row[rng.permutation(spoiled)]
    places = rng.standard_normal((num, 3))[labels]
    return labels, maps, places + 0.2 * rng.standard_normal(places.shape)


def _same_labels(found, planted):
    """Share of samples whose label stands for the planted one, after the best naming of labels."""
    counts = np.zeros((planted.shape[1],) * 2)
    np.add.at(counts, (found.ravel(), planted.ravel()), 1)
    return float((counts.argmax(axis=1)[found] == planted).mean())


@pytest.mark.parametrize(
    ("edges", "wrong"), [(complete_edges(30), 0.0), (complete_edges(30), 0.4), (SPARSE, 0.15)]
)
def test_labels_are_recovered_and_maps_compose(edges, wrong):
    rng = np.random.default_rng(0)
    planted, maps, places = _planted(rng, 30, 20, edges, wrong)
    found = synchronize_maps(edges, maps, np.ones(len(edges)), rng.permutation(places, axis=1))
    assert _same_labels(found, planted) == 1.0
    assert np.array_equal(np.sort(found, axis=1), np.tile(np.arange(20), (30, 1)))
    assert _same_labels(np.roll(found, 1, axis=1), planted) < 0.5


def test_maps_count_by_their_weights_and_places_where_maps_say_nothing():
    rng, edges = np.random.default_rng(3), complete_edges(10)
    planted, maps, places = _planted(rng, 10, 15, edges, 0.0)
    wrong = rng.random(len(edges)) < 0.6
    maps[wrong] = np.roll(maps[wrong], 1, axis=1)
    anywhere = rng.standard_normal(places.shape)
    trusted = synchronize_maps(edges, maps, np.where(wrong, 0.1, 1.0), anywhere)
    assert _same_labels(trusted, planted) == 1.0
    assert (
        _same_labels(synchronize_maps(edges, maps, np.where(wrong, 1.0, 0.1), anywhere), planted)
        < 1.0
    )
    near = places - 0.9 * (places - places[0, np.argsort(planted[0])][planted])
    assert _same_labels(synchronize_maps(edges[:1], maps[:1], np.zeros(1), near), planted) == 1.0


def test_points_without_a_partner_say_nothing():
    rng, edges = np.random.default_rng(2), complete_edges(8)
    planted, maps, _ = _planted(rng, 8, 9, edges, 0.0)
    partial = np.where(rng.random(maps.shape) < 0.4, -1, maps)
    assert _same_labels(synchronize_permutations(edges, partial), planted) == 1.0
    none = np.full_like(maps[:1], -1)
    with pytest.raises(InputError, match="none connects shape 1 with shape 0"):
        synchronize_permutations(edges[:1], none)


@pytest.mark.parametrize(
    ("changed", "kind", "message"),
    [
        ({"maps": [[0, 0, 1]]}, InputError, "row 0 takes point 0 twice"),
        ({"maps": [[0, 1, 3]]}, InputError, "indices run from 0 to 3"),
        ({"maps": [[0, -2, 1]]}, InputError, "indices run from -2"),
        ({"maps": [0, 1, 2]}, InputError, "maps"),
        ({"edges": [(0, 0)]}, InputError, "to itself"),
        ({"edges": [(0, 1), (1, 0)], "maps": [[0, 1, 2]] * 2}, InputError, "more than once"),
        ({"edges": []}, InputError, "no pairs"),
        ({"weights": [0.0]}, InputError, "all weights are zero"),
        ({"num_shapes": 0}, OptionsError, "num_shapes"),
        ({"positions": np.zeros((2, 4, 3))}, InputError, "4 points a shape, but maps of 3"),
        ({"positions": np.zeros((2, 3, 3)), "num_shapes": 3}, InputError, "of 2 shapes"),
    ],
)
def test_maps_that_are_none_are_refused(changed, kind, message):
    given = {"edges": [(0, 1)], "maps": [[2, 0, 1]]}
    assert synchronize_permutations(**given).shape == (2, 3)
    with pytest.raises(kind, match=message):
        synchronize_permutations(**given | changed)


def test_scales_are_recovered():
    rng = np.random.default_rng(4)
    scales, mean = rng.uniform(0.5, 2.0, 8), rng.standard_normal((25, 3))
    shapes = (mean + rng.standard_normal((8, 1, 3))) / scales[:, None, None]
    found = common_scales(shapes)
    assert np.allclose(found / found[0], scales / scales[0])
    assert np.exp(np.log(found).mean()) == pytest.approx(1.0)
    noisy = shapes + 0.2 * rng.standard_normal(shapes.shape)
    centred = noisy - noisy.mean(axis=1, keepdims=True)
    best = common_scales(noisy)
    fitted = (centred * (best[:, None, None] * centred).mean(axis=0)).sum(axis=(1, 2)) / (
        centred**2
    ).sum(axis=(1, 2))
    assert np.allclose(fitted / fitted[0], best / best[0])


def _small_turns(rng, count):
    skew = rng.standard_normal((count, 3, 3)) * 0.1
    skew = skew - np.swapaxes(skew, 1, 2)
    return np.linalg.solve(np.eye(3) - skew / 2, np.eye(3) + skew / 2)


def test_alternation_of_assignments_and_rotations():
    rng = np.random.default_rng(5)
    cloud = rng.standard_normal((14, 3)) * [3.0, 2.0, 1.0]
    truth = random_rotations(rng, 6)
    samples = [rng.permutation(cloud + 0.02 * rng.standard_normal(cloud.shape)) @ g for g in truth]
    rough = truth @ _small_turns(rng, 6)
    rotations, maps, energies = alternate_assignments(samples, rough)
    assert (np.diff(energies) <= 1e-12).all()
    assert energies[-1] < 0.5 * energies[0]
    relative = np.swapaxes(rotations[0], 0, 1) @ rotations
    assert np.abs(relative - np.swapaxes(truth[0], 0, 1) @ truth).max() < 0.05
    again, energy = assign_all_pairs(samples, rotations)
    assert energy <= energies[-1] + 1e-12
    assert len(maps) == len(again) == 15
    with pytest.raises(InputError, match="samples"):
        alternate_assignments(samples[:5], rough)
