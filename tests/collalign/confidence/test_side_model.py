"""Two sides are found in planted preferences, and not in noise."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.confidence.side_model import MIN_SHAPES, Sides, find_sides, preferences
from collalign.stages.pairs.sparse_pairs import all_pairs
from data_tools.errors import InputError


def planted(rng, mirrored, *, clear=0.3, noise=0.1):
    """Energies of all pairs whose preferences are ``clear`` for the sides, plus normal noise."""
    edges = all_pairs(len(mirrored))
    agree = np.where(mirrored[edges[:, 0]] == mirrored[edges[:, 1]], 1.0, -1.0)
    preference = clear * agree + noise * rng.standard_normal(len(edges))
    return edges, 0.1 * np.exp(np.stack([-preference, preference], axis=1) / 2)


def sides_of(mirrored, **strength):
    return find_sides(*planted(np.random.default_rng(3), mirrored, **strength), len(mirrored))


@pytest.mark.parametrize("share", [1, 3, 10])
def test_planted_sides_are_found_and_clear(share):
    mirrored = np.roll(np.arange(20) < share, 7)
    found = sides_of(mirrored)
    assert found.are_suspected
    assert found.are_clear
    assert np.array_equal(found.mirrored, mirrored) or np.array_equal(found.mirrored, ~mirrored)
    assert found.mirrored.sum() == share
    assert found.are_obvious
    assert not sides_of(mirrored, clear=0.15, noise=0.05).are_obvious
    assert found.num_between == share * (20 - share)
    assert found.median_between == pytest.approx(0.3, abs=0.1)


def test_a_shape_whose_pairs_contradict_each_other_is_unsure_of_its_side():
    edges, energies = planted(np.random.default_rng(3), np.arange(20) < 5)
    assert not find_sides(edges, energies, 20).unsure.any()
    swapped = (edges == 9).any(axis=1) & (edges.sum(axis=1) % 2 == 0)
    energies[swapped] = energies[swapped, ::-1]
    assert np.flatnonzero(find_sides(edges, energies, 20).unsure).tolist() == [9]


def test_one_side_is_no_mix_nor_are_strong_preferences_that_contradict_each_other():
    assert not sides_of(np.zeros(20, dtype=bool), clear=0.0, noise=0.6).are_clear
    found = sides_of(np.zeros(20, dtype=bool))
    assert not found.mirrored.any()
    assert not found.are_suspected
    assert not found.are_clear
    assert np.isnan(found.median_between)


@pytest.mark.parametrize("num", [4, 6, 8, 12, 20, 40])
def test_preferences_at_random_are_never_clear(num):
    rng = np.random.default_rng(num)
    for _ in range(25):
        edges, energies = planted(rng, np.zeros(num, dtype=bool), clear=0.0, noise=0.1)
        assert not find_sides(edges, energies, num).are_clear


def test_too_few_shapes_are_never_mirrored():
    few = np.arange(MIN_SHAPES - 1) < 2
    assert sides_of(few, clear=2.0).are_suspected
    assert not sides_of(few, clear=2.0).are_clear
    assert sides_of(np.arange(MIN_SHAPES) < 2, clear=2.0).are_clear


def test_failed_pairs_are_left_out_and_parts_are_judged_apart():
    mirrored = np.arange(16) % 8 == 2
    edges, energies = planted(np.random.default_rng(1), mirrored)
    energies[(edges[:, 0] < 8) & (edges[:, 1] >= 8), 1] = np.nan
    found = find_sides(edges, energies, 16)
    assert found.num_pairs == 2 * 28
    assert np.array_equal(found.mirrored, mirrored)
    nothing = find_sides(edges, np.full(energies.shape, np.nan), 16)
    assert (nothing.num_pairs, nothing.are_suspected, nothing.are_clear) == (0, False, False)


def test_preferences_are_antisymmetric_and_bounded():
    energies = np.array([[1.0, np.e], [np.e, 1.0], [0.0, 1.0], [0.0, 0.0]])
    assert preferences(energies) == pytest.approx([1.0, -1.0, 5.0, 0.0])


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="energies"):
        find_sides([[0, 1]], [[1.0, 1.0], [1.0, 1.0]], 2)
    with pytest.raises(InputError, match="edges"):
        find_sides([[0, 5]], [[1.0, 1.0]], 2)


CLEAR = Sides(
    mirrored=np.arange(6) < 2,
    unsure=np.zeros(6, dtype=bool),
    num_pairs=100,
    num_between=40,
    median_all=0.3,
    median_between=0.3,
    contradicted=0.0,
    balance=1.0,
)


def test_each_condition_alone_decides_whether_sides_are_clear():
    assert CLEAR.are_suspected
    assert CLEAR.are_clear
    assert CLEAR.are_obvious
    for change in (
        {"mirrored": np.arange(5) < 2},
        {"num_between": 0},
        {"median_all": 0.09},
        {"median_between": 0.14, "num_between": 10},  # fewer pairs have to say more
        {"contradicted": 0.041},
        {"balance": 0.6},
    ):
        assert not replace(CLEAR, **change).are_clear, change
        assert not replace(CLEAR, **change).are_obvious, change
    assert replace(CLEAR, median_all=0.1, median_between=0.1).are_clear
    assert not replace(CLEAR, median_all=0.14, num_pairs=25).are_clear


def test_few_or_weak_pairs_leave_room_for_more():
    assert not replace(CLEAR, num_pairs=99).are_obvious
    assert not replace(CLEAR, median_all=0.19).are_obvious
    assert not replace(CLEAR, median_between=0.19).are_obvious
    assert not replace(CLEAR, num_between=0).are_suspected
    assert not replace(CLEAR, median_all=0.05).are_suspected
    assert not replace(CLEAR, median_between=0.04).are_suspected


def test_sides_may_be_likely_without_being_clear():
    few = replace(CLEAR, mirrored=np.arange(4) < 1, num_pairs=5, num_between=3)
    assert few.are_likely
    assert not few.are_clear
    for change in (
        {"num_between": 0},
        {"median_between": 0.08},
        {"contradicted": 0.11},
        {"balance": 0.79},
        {"median_all": 0.05},
    ):
        assert not replace(few, **change).are_likely, change
    assert replace(few, median_between=0.09, contradicted=0.09, balance=0.81).are_likely
