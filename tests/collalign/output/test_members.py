"""Which shapes are kept so that a share of their poses is expected to be right."""

import dataclasses

import numpy as np
import pytest

from collalign.confidence.reliability_model import RIGHT, STEPS, expected_right
from collalign.output.members import select_right, statistics_members
from data_tools.errors import OptionsError
from tests.products import kind_of
from tests.view_problems import view_of


def stated(*confidence):
    return dataclasses.replace(view_of(len(confidence)), confidence=np.array(confidence))


def test_what_is_stated_more_surely_is_right_more_often():
    found = expected_right(np.array([*STEPS, 1.0, np.nan, 0.97]))
    assert found[:6].tolist() == [*RIGHT]
    assert found[6] == RIGHT[-1]
    assert np.isnan(found[7])
    assert RIGHT[-3] <= found[8] <= RIGHT[-2]
    assert [*RIGHT] == sorted(RIGHT)


def test_as_many_are_kept_as_the_share_allows():
    collection = stated(0.999, 0.96, 0.998, 0.4, np.nan, 0.997)
    sure = collection.select(right=0.996)
    assert sure.names == tuple(collection.names[at] for at in (0, 2, 5))
    assert sure.chosen.tolist() == [0, 2, 5]
    assert sure.right == pytest.approx(RIGHT[-1])
    assert sure.least_confidence == 0.997
    assert "keeps 3 of 6 shapes, stated at 0.997 or more; 99.8% of these" in str(sure)
    more = collection.select(right=0.97)
    assert len(more) == 4
    assert more.right >= 0.97 > collection.select(right=0.8).right
    assert len(collection.select(right=0.0)) == 5, "a shape without a confidence is never kept"
    assert len(collection.some(sure.chosen)) == 3
    assert collection.names[0] in sure
    assert collection.names[1] not in sure


def test_none_is_kept_where_none_is_sure():
    found = stated(0.4, 0.3).select(right=0.99)
    assert len(found) == 0
    assert np.isnan(found.right)
    assert "keeps none of 2 shapes" in str(found)
    with pytest.raises(OptionsError, match="right: expected a number"):
        select_right(stated(0.4, 0.3), 95)


def test_the_only_shape_of_its_kind_is_left_out_and_not_in_doubt():
    kinds = kind_of("a", [0, 1, 2]), kind_of("b", [3])
    collection = dataclasses.replace(
        stated(0.99, 0.99, 0.5, np.nan), kinds=kinds, part_numbers=np.array([0, 0, 0, 1])
    )
    assert collection.is_doubtful.tolist() == [False, False, True, False]
    names = collection.names
    assert statistics_members(collection).left_out == ((names[2], "doubtful"), (names[3], "alone"))
