"""Consistent labels, generalised Procrustes analysis, and the paper's alternation of assignments and rotations."""

import numpy as np
import pytest

from collalign.synchronization import alternate_assignments, superimpose, synchronize_maps
from collalign.synchronization.solvers.spectral import assign_all_pairs
from data_tools.errors import InputError
from tests.synchronization_problems import complete_edges, map_between, random_rotations, regular_edges


def _planted_labels(rng: np.random.Generator, num_shapes: int, universe: int, sizes: np.ndarray) -> list[np.ndarray]:
    return [rng.permutation(universe)[: sizes[i]] for i in range(num_shapes)]


def _maps(labels, edges, rng, wrong: float) -> dict[tuple[int, int], np.ndarray]:
    """Maps of planted labels in which a share of the matches is permuted at random."""
    maps = {}
    for i, j in edges:
        place = {label: sample for sample, label in enumerate(labels[i])}
        found = np.array([place.get(label, -1) for label in labels[j]])
        spoiled = np.flatnonzero(rng.random(len(found)) < wrong)
        found[spoiled] = found[rng.permutation(spoiled)]
        maps[int(i), int(j)] = found
    return maps


def _same_labels(found, planted) -> float:
    """Share of samples whose label stands for the planted one, after the best naming of labels."""
    pairs = np.concatenate([np.stack([a, b], axis=1) for a, b in zip(found, planted, strict=True)])
    named = {}
    for label in np.unique(pairs[:, 0]):
        values, counts = np.unique(pairs[pairs[:, 0] == label, 1], return_counts=True)
        named[label] = values[np.argmax(counts)]
    return float(np.mean([named[a] == b for a, b in pairs]))


@pytest.mark.parametrize("wrong", [0.0, 0.4])
def test_labels_are_recovered_and_maps_compose(wrong: float) -> None:
    rng = np.random.default_rng(0)
    planted = _planted_labels(rng, 30, 20, np.full(30, 20))
    maps = _maps(planted, complete_edges(30), rng, wrong)
    found = synchronize_maps(maps, [20] * 30)
    assert _same_labels(found.labels, planted) == 1.0
    for a, b, c in ((0, 5, 9), (3, 1, 28), (7, 7, 2)):
        composed = map_between(found, a, b)[map_between(found, b, c)]
        assert np.array_equal(composed, map_between(found, a, c))
    assert found.agreement == pytest.approx(1.0 - wrong, abs=0.08)


@pytest.mark.parametrize("held", [1, 16 * 40, 2**22])
def test_how_much_is_held_at_once_does_not_matter(held: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    sizes = rng.integers(12, 17, 25)
    planted = _planted_labels(rng, 25, 16, sizes)
    maps = _maps(planted, regular_edges(25, 8, 0), rng, 0.2)
    places = rng.standard_normal((16, 3))
    clouds = [places[labels] + 0.2 * rng.standard_normal((len(labels), 3)) for labels in planted]
    whole = synchronize_maps(maps, sizes, positions=clouds, universe=16, min_support=0.85)
    monkeypatch.setattr("collalign.synchronization.maps.permutations.MOST_HELD", held)
    parts = synchronize_maps(maps, sizes, positions=clouds, universe=16, min_support=0.85)
    assert parts.rounds == whole.rounds > 1
    assert all(np.array_equal(a, b) for a, b in zip(parts.labels, whole.labels, strict=True))
    assert any((labels == -1).any() for labels in whole.labels)


def test_sparse_maps_and_different_numbers_of_samples() -> None:
    rng = np.random.default_rng(1)
    sizes = rng.integers(12, 17, 40)
    planted = _planted_labels(rng, 40, 16, sizes)
    maps = _maps(planted, regular_edges(40, 10, 0), rng, 0.15)
    found = synchronize_maps(maps, sizes, universe=16)
    assert _same_labels(found.labels, planted) > 0.97
    assert all(len(np.unique(labels)) == len(labels) for labels in found.labels)
    assert max(labels.max() for labels in found.labels) < 16


def test_unsupported_samples_stay_unmatched() -> None:
    rng = np.random.default_rng(2)
    planted = _planted_labels(rng, 12, 10, np.full(12, 10))
    maps = _maps(planted, complete_edges(12), rng, 0.0)
    for pair in maps:
        if 4 in pair:
            maps[pair] = np.full(10, -1)
    found = synchronize_maps(maps, [10] * 12, min_support=0.5)
    assert (found.labels[4] == -1).all()
    assert (map_between(found, 0, 4) == -1).all()
    assert all(sorted(found.labels[i]) == list(range(10)) for i in range(12) if i != 4)


def test_positions_label_what_maps_leave_open() -> None:
    rng = np.random.default_rng(3)
    cloud = rng.standard_normal((15, 3))
    planted = [rng.permutation(15) for _ in range(10)]
    positions = [cloud[order] + 0.02 * rng.standard_normal((15, 3)) for order in planted]
    found = synchronize_maps({(0, 1): np.full(15, -1)}, [15] * 10, positions=positions)
    assert _same_labels(found.labels, planted) == 1.0


def test_bad_maps_are_refused() -> None:
    good = {(0, 1): np.array([1, 0, 2])}
    assert synchronize_maps(good, [3, 3]).agreement == 1.0
    bad = [
        ({(0, 2): [0, 1, 2]}, {}, "pair"),
        ({(0, 0): [0, 1, 2]}, {}, "pair"),
        ({(0, 1): [0, 1, 3]}, {}, "indices"),
        ({(0, 1): [0, 1]}, {}, "shape"),
        ({(0, 1): [1, 1, 2]}, {}, "two samples"),
        (good, {"weights": {(0, 1): -1.0}}, "weights"),
        (good, {"universe": 2}, "num_samples"),
        (good, {"positions": [np.zeros((3, 3))]}, "positions"),
    ]
    for maps, options, words in bad:
        with pytest.raises(InputError, match=words):
            synchronize_maps(maps, [3, 3], **options)


def test_procrustes_recovers_similarities() -> None:
    rng = np.random.default_rng(4)
    cloud = rng.standard_normal((25, 3))
    rotations = random_rotations(rng, 8, group="O")
    scales = rng.uniform(0.5, 2.0, 8)
    labels = [rng.permutation(25)[:22] for _ in range(8)]
    shifts = rng.standard_normal((8, 3))
    samples = [((cloud[v] - t) / s) @ r for v, r, s, t in zip(labels, rotations, scales, shifts, strict=True)]
    found = superimpose(samples, labels, rotations)
    assert np.allclose(found.scale / found.scale[0], scales / scales[0], atol=1e-6)
    assert np.exp(np.log(found.scale).mean()) == pytest.approx(1.0)
    posed = [s * x @ r.T + t for x, r, s, t in zip(samples, rotations, found.scale, found.shift, strict=True)]
    places = np.full((8, 25, 3), np.nan)
    for row, v, points in zip(places, labels, posed, strict=True):
        row[v] = points
    assert np.nanstd(places, axis=0).max() < 1e-6
    assert np.allclose(np.nanmean(places, axis=(0, 1)), 0.0, atol=0.1)
    fixed = superimpose(samples, labels, rotations, with_scale=False)
    assert np.array_equal(fixed.scale, np.ones(8))


def _small_turns(rng: np.random.Generator, count: int) -> np.ndarray:
    skew = rng.standard_normal((count, 3, 3)) * 0.1
    skew = skew - np.swapaxes(skew, 1, 2)
    return np.linalg.solve(np.eye(3) - skew / 2, np.eye(3) + skew / 2)


def test_procrustes_refuses_what_does_not_fit() -> None:
    samples, labels = [np.eye(3)] * 2, [np.arange(3)] * 2
    with pytest.raises(InputError, match="same shapes"):
        superimpose(samples, labels, np.tile(np.eye(3), (3, 1, 1)))
    with pytest.raises(InputError, match="two labelled"):
        superimpose(samples, [np.arange(3), np.array([0, -1, -1])], np.tile(np.eye(3), (2, 1, 1)))


def test_alternation_of_assignments_and_rotations() -> None:
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
