"""Two sides are found in planted preferences, and not in noise."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.confidence.side_model import (
    MIN_SHAPES_FOR_SIDES,
    Sides,
    SurfaceSides,
    are_bilateral,
    are_mixed,
    are_one_kind,
    are_open,
    find_sides,
    look_like_posture,
    surface_sides,
    undecided_sides,
)
from collalign.stages.choose_pairs import all_pairs
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
def test_planted_sides_are_found(share):
    mirrored = np.roll(np.arange(20) < share, 7)
    found = sides_of(mirrored)
    assert found.are_suspected
    assert found.are_likely
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


@pytest.mark.parametrize("num", [6, 8, 12, 20, 40])
def test_preferences_at_random_are_hardly_ever_likely(num):
    rng = np.random.default_rng(num)
    found = [
        find_sides(*planted(rng, np.zeros(num, dtype=bool), clear=0.0, noise=0.1), num).are_likely
        for _ in range(25)
    ]
    assert sum(found) <= 1


def test_failed_pairs_are_left_out_and_parts_are_judged_apart():
    mirrored = np.arange(16) % 8 == 2
    edges, energies = planted(np.random.default_rng(1), mirrored)
    energies[(edges[:, 0] < 8) & (edges[:, 1] >= 8), 1] = np.nan
    found = find_sides(edges, energies, 16)
    assert found.num_pairs == 2 * 28
    assert np.array_equal(found.mirrored, mirrored)
    nothing = find_sides(edges, np.full(energies.shape, np.nan), 16)
    assert (nothing.num_pairs, nothing.are_suspected, nothing.are_likely) == (0, False, False)


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
CONFIRMED = SurfaceSides(mirrored=np.arange(6) < 2, support=np.full(6, 9e-4), across=9e-4)


def test_each_condition_alone_decides_whether_sides_are_likely():
    few = replace(CLEAR, mirrored=np.arange(4) < 1, num_pairs=5, num_between=3)
    assert few.are_likely
    for change in (
        {"num_between": 0},
        {"median_between": 0.08},
        {"contradicted": 0.11},
        {"balance": 0.79},
        {"median_all": 0.04},
    ):
        assert not replace(few, **change).are_likely, change
    assert replace(few, median_between=0.09, contradicted=0.09, balance=0.81).are_likely


def test_shapes_are_mirrored_where_fits_and_surfaces_agree():
    assert are_mixed(CLEAR, CONFIRMED)
    for change in (
        {"mirrored": np.arange(MIN_SHAPES_FOR_SIDES - 1) < 2},
        {"num_between": 0},
        {"median_all": 0.1},  # weak fits need stronger support
        {"contradicted": 0.041},
        {"balance": 0.7},
    ):
        assert not are_mixed(replace(CLEAR, **change), CONFIRMED), change
    for change in ({"across": 3e-4}, {"support": np.full(6, 3e-4)}, {"across": np.nan}):
        assert not are_mixed(CLEAR, replace(CONFIRMED, **change)), change
    assert are_mixed(replace(CLEAR, median_all=0.5), replace(CONFIRMED, across=3e-4))


WEAK = replace(CONFIRMED, support=np.full(6, 1e-4), across=1e-4)
NOTHING_ALONE = SurfaceSides(mirrored=np.arange(6) == 4, support=np.full(6, 2e-4), across=2e-4)


def test_sides_that_surfaces_do_not_confirm_look_like_posture():
    assert look_like_posture(CLEAR, WEAK)
    assert look_like_posture(CLEAR, replace(CONFIRMED, across=-1e-4))
    assert not look_like_posture(CLEAR, replace(CONFIRMED, across=2e-4))
    assert not look_like_posture(CLEAR, replace(CONFIRMED, across=np.nan))
    assert not look_like_posture(replace(CLEAR, mirrored=np.arange(5) < 2), WEAK)
    assert not look_like_posture(replace(CLEAR, balance=0.7), WEAK)


def test_suspected_sides_that_surfaces_share_are_open():
    suspected = replace(CLEAR, median_between=0.05)
    assert not suspected.are_likely
    assert are_open(suspected, CONFIRMED)
    assert not are_open(suspected, WEAK)
    assert not are_open(replace(CLEAR, median_between=0.04), CONFIRMED), "not even suspected"
    unsure = replace(suspected, unsure=np.arange(6) == 5)
    assert undecided_sides(unsure, CONFIRMED, NOTHING_ALONE).tolist() == [
        True,
        True,
        False,
        False,
        True,
        True,
    ]
    assert not undecided_sides(unsure, WEAK, NOTHING_ALONE).any()


def test_two_kinds_of_shapes_are_no_two_sides():
    edges = all_pairs(6)
    mirrored = np.arange(6) < 2
    between = mirrored[edges[:, 0]] != mirrored[edges[:, 1]]
    energies = np.where(between[:, None], [0.5, 0.1], [0.1, 0.5])
    assert are_one_kind(mirrored, edges, energies)
    assert not are_one_kind(mirrored, edges, energies * np.where(between, 3.0, 1.0)[:, None])
    assert not are_one_kind(mirrored, edges[~between], energies[~between]), "never compared"
    assert are_one_kind(mirrored, edges[between], energies[between])


def scores_of(mirrored, size, noise, rng):
    """Scores of planted sides, with normal noise."""
    signs = np.where(mirrored, -1.0, 1.0)
    scores = size * np.outer(signs, signs) + noise * rng.standard_normal((len(signs), len(signs)))
    scores = (scores + scores.T) / 2
    np.fill_diagonal(scores, np.nan)
    return scores


@pytest.mark.parametrize("num", [3, 5, 8, 20])
def test_surfaces_of_strong_chirality_name_both_sides(num, rng):
    mirrored = np.arange(num) == 1
    found = surface_sides(scores_of(mirrored, 3e-3, 2e-4, rng))
    assert found.are_clear
    assert np.array_equal(found.mirrored, mirrored)
    assert found.across == pytest.approx(3e-3, rel=0.2)
    assert found.support == pytest.approx(np.full(num, 3e-3), rel=0.2)
    assert not surface_sides(scores_of(np.zeros(num, dtype=bool), 3e-3, 2e-4, rng)).are_clear, (
        "one side"
    )
    assert not surface_sides(scores_of(mirrored, 0.0, 2e-4, rng)).are_clear, "bilateral"
    assert not surface_sides(scores_of(mirrored, 5e-4, 1e-5, rng)).are_clear, "too weak"


def test_given_sides_are_judged_and_unknown_surfaces_left_out(rng):
    mirrored = np.arange(6) < 2
    scores = scores_of(mirrored, 1e-3, 0.0, rng)
    right = surface_sides(scores, mirrored)
    assert (right.agreement, right.across) == pytest.approx((1e-3, 1e-3))
    wrong = surface_sides(scores, np.arange(6) == 5)
    assert wrong.across == pytest.approx(-0.2e-3 * 3 + 0.2e-3 * 2)
    assert wrong.agreement == wrong.across
    scores[3] = scores[:, 3] = np.nan
    some = surface_sides(scores, mirrored)
    assert np.isnan(some.support).tolist() == [i == 3 for i in range(6)]
    assert some.agreement == pytest.approx(1e-3)
    nothing = surface_sides(np.full((4, 4), np.nan))
    assert not nothing.are_known
    assert not nothing.are_clear
    assert np.isnan(nothing.agreement)


def test_shapes_are_bilateral_where_they_are_more_like_their_mirror_images_than_like_others():
    others = np.array([[0.1, 0.4]])
    assert are_bilateral(np.array([[0.03, 0.1]]), others)
    assert not are_bilateral(np.array([[0.1, 0.4]]), others)
    assert not are_bilateral(np.array([[0.04, 0.4]]), others), "neighbourhoods differ"
    assert are_bilateral(np.array([[0.02, np.nan]]), others), "nothing is known of them"
    assert not are_bilateral(np.array([[0.0, 0.0]]), np.zeros((1, 2))), "others are as alike"
    several = np.array([[0.03, 0.1], [0.03, 0.1], [0.1, 0.4]])
    assert are_bilateral(several, np.tile(others, (3, 1)))
    assert not are_bilateral(several[[0, 2, 2]], np.tile(others, (3, 1)))
