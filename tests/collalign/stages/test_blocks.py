"""Shapes that support one another in a pose are as doubtful as the block that they are."""

import numpy as np
import pytest

from collalign.stages.trust.blocks import block_margins

HALVES = np.arange(6) % 2 == 0


def between(values, blocks=HALVES, within=1.0):
    """Return a matrix with one value for pairs between blocks and one within."""
    return np.where(blocks[:, None] != blocks, values, within)


def test_a_block_is_as_doubtful_as_its_pairs_with_the_others():
    margins = block_margins(between(0.1), np.zeros((6, 6)))
    np.testing.assert_allclose(margins, 0.1)  # of a shape alone: .46


def test_only_the_smaller_side_is_in_doubt():
    alone = np.arange(6) == 2
    margins = block_margins(between(0.1, alone), np.zeros((6, 6)))
    assert margins[2] == pytest.approx(0.1)
    assert np.delete(margins, 2).min() > 0.5


def test_the_rotation_of_either_side_is_looked_at():
    rises = between(0.4)
    rises[np.ix_(HALVES, ~HALVES)] = 0.2
    np.testing.assert_allclose(block_margins(rises, np.zeros((6, 6))), 0.2)


def test_how_distinct_a_block_is_counts_against_its_margin():
    rises = between(0.5)
    np.testing.assert_allclose(block_margins(rises, between(0.7, within=0.0)), -0.2)
    np.testing.assert_allclose(block_margins(rises, between(-0.7, within=0.0)), 0.5)


def test_pairs_that_were_not_tried_say_nothing():
    rises = between(0.1)
    rises[0, 1] = rises[2, 4] = np.nan
    costs = np.zeros((6, 6))
    costs[np.isnan(rises)] = np.nan
    np.testing.assert_allclose(block_margins(rises, costs), 0.1)
    assert np.isinf(block_margins(np.full((3, 3), np.nan), np.zeros((3, 3)))).all()


def test_a_pair_is_two_blocks():
    np.testing.assert_allclose(block_margins(between(0.3, HALVES[:2]), np.zeros((2, 2))), 0.3)
