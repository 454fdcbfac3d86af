"""Votes of pairs, counted one by one."""

import numpy as np
import pytest

from pairwise.features.votes import counted_votes, most_voted


def test_votes_are_counted_at_their_reference_place_and_step():
    alike = np.array([0, 2]), np.array([2, 3]), np.array([1, 0, 2])
    first = np.array([0, 1]), np.array([4, 3, 0])
    quarter = 0.5 * np.pi
    turns = np.array([0.0, quarter]), np.array([quarter, 1.25 * quarter, 0.0])
    votes, beyond = counted_votes(alike, first, turns, (2, 5, 4))
    expected = np.zeros((2, 5, 4))
    expected[0, 3, 1] = expected[0, 4, 1] = np.sqrt(0.5)  # two pairs look alike: each says less
    expected[1, 0, 3] = 1.0  # a quarter backwards is three forwards
    np.testing.assert_allclose(votes, expected)
    assert beyond[0, 3, 1] == pytest.approx(0.25 * np.sqrt(0.5))
    assert beyond.sum() == pytest.approx(0.25 * np.sqrt(0.5))


def test_pairs_that_nothing_looks_like_have_no_votes():
    none = np.zeros(2, dtype=np.int64)
    alike, first = (none, none, none), (none, none)
    votes, beyond = counted_votes(alike, first, (np.zeros(2), np.zeros(2)), (1, 2, 3))
    assert not votes.any()
    assert not beyond.any()


@pytest.mark.parametrize("num", [1, 3, 8])
def test_most_voted_is_what_a_stable_sort_puts_first(num):
    votes = np.random.default_rng(num).integers(0, 6, (20, 50)).astype(float)
    expected = np.argsort(-votes, axis=1, kind="stable")[:, :num]
    np.testing.assert_array_equal(most_voted(votes, num), expected)
    wrong = np.argsort(votes, axis=1, kind="stable")[:, :num]
    assert (most_voted(votes, num) != wrong).any()
