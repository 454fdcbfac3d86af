"""Which pieces of each shape are matched is decided by what its pairs tell of poses by either reading."""

import itertools

import numpy as np
import pytest

from collalign.stages.pieces import (
    LEAST_GAIN,
    NUM_ASKED,
    asked_pairs,
    consistent_readings,
    tells_apart,
)
from tests.products import pair_of

SAME, HALF_TURN = np.eye(3), np.diag([-1.0, -1.0, 1.0])


def readings(num, has_two, largest, whole):
    """Return which shapes are read whole, where pairs of i and j tell what two functions of both say."""
    pairs = [*itertools.combinations(range(num), 2)]
    by_largest, by_all = ({(i, j): told(i, j) for i, j in pairs} for told in (largest, whole))
    return consistent_readings(np.array(has_two), by_largest, by_all).tolist()


def test_shapes_are_read_as_their_pairs_tell_more():
    two = [True] * 4
    assert readings(4, two, lambda *_: 1.0, lambda *_: 3.0) == [True] * 4
    assert readings(4, two, lambda *_: 3.0, lambda *_: 1.0) == [False] * 4
    only_little_more = readings(4, two, lambda *_: 1.0 + 0.5 * LEAST_GAIN, lambda *_: 1.0)
    assert only_little_more == [True] * 4, "all pieces are the shape"


def test_a_shape_is_read_like_those_that_it_is_compared_with():
    def largest(i, j):
        return 2.0 if 0 in (i, j) else 1.0

    assert readings(5, [True] * 5, largest, lambda *_: 1.6) == [True] * 5
    whole = readings(5, [True, *[False] * 4], largest, lambda *_: 3.0)
    assert whole == [True, *[False] * 4], "of one piece there is but one reading"


def test_what_cannot_be_matched_by_one_reading_tells_nothing_by_it():
    pairs = dict.fromkeys(itertools.combinations(range(4), 2), 1.0)
    two = np.ones(4, dtype=bool)
    assert consistent_readings(two, {}, pairs).all()
    assert not consistent_readings(two, pairs, {}).any()
    assert consistent_readings(two, {}, {}).all(), "all pieces are the shape"


def test_kinds_are_read_each_as_suits_it():
    def told(good):
        return lambda i, j: 0.0 if (i < 3) != (j < 3) else 3.0 if (i < 3) == good else 1.0

    assert readings(6, [True] * 6, told(True), told(False)) == [False] * 3 + [True] * 3


def test_shapes_of_one_kind_are_read_alike_whichever_partners_tell():
    """Two of eight shapes tell the readings apart; the others were matched with one of these, or with none."""
    alike = {pair: 4.0 for pair in itertools.combinations(range(6), 2) if sum(pair) % 2}
    clear = {(0, 6): 4.0, (2, 7): 4.0, (4, 6): 4.0, (6, 7): 4.0}
    by_all = {**alike, **dict.fromkeys(clear, 1.0)}
    assert not consistent_readings(np.ones(8, dtype=bool), alike | clear, by_all).any()


def test_a_pair_tells_little_where_poses_fit_alike_or_surfaces_mismatch():
    def told(energies, mismatches, rotations=(SAME, HALF_TURN)):
        return tells_apart(pair_of(np.stack(rotations), energies, mismatches=np.array(mismatches)))

    one = told([0.1, 0.4], [0.2, 0.6])
    assert told([0.1, 0.1], [0.2, 0.2]) < one
    assert told([0.1, 0.4], [0.8, 0.9]) < one
    assert told([0.1, 0.4], [1.2, 1.3]) == 0.0
    near = told([0.1, 0.1], [0.2, 0.2], (SAME, SAME))
    assert near == pytest.approx(one, abs=0.2), "candidates of one pose are one"
    assert 0.0 < told([0.1, 0.4], [np.nan, np.nan]) < told([0.1, 0.4], [0.0, 0.5])


def test_each_shape_of_two_readings_is_matched_with_some_others_whatever_their_order():
    keys, two = [f"key {i}" for i in range(30)], np.arange(30) % 3 > 0
    pairs = asked_pairs(keys, 0, two)
    counts = np.bincount(pairs.ravel(), minlength=30)
    assert counts[two].min() >= NUM_ASKED
    assert two[pairs].any(axis=1).all()
    assert len(pairs) <= NUM_ASKED * 30
    order = np.random.default_rng(0).permutation(30)
    again = order[asked_pairs([keys[i] for i in order], 0, two[order])]
    assert {*map(frozenset, again.tolist())} == {*map(frozenset, pairs.tolist())}
    assert not len(asked_pairs(keys, 0, np.zeros(30, dtype=bool)))
