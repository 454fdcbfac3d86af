"""Validators accept what is right, copy it, and refuse what is wrong by name."""

import numpy as np
import pytest

from data_tools import arrays
from data_tools.errors import InputError


def test_points_become_fresh_contiguous_float64():
    given = np.arange(12, dtype=np.int32).reshape(4, 3)[::2]
    points = arrays.as_points(given, "points")
    assert points.dtype == np.float64
    assert points.flags.c_contiguous
    points[0, 0] = 7
    assert given[0, 0] == 0


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ([[0.0, np.nan, 1.0]], "NaN"),
        ([[0.0, np.inf, 1.0]], "infinite"),
        (np.zeros((2, 4)), "shape"),
        (np.zeros(3), "shape"),
        (np.zeros((0, 3)), "at least 1"),
        ([["a", "b", "c"]], "real numbers"),
        (np.zeros((1, 3), complex), "real numbers"),
    ],
)
def test_bad_points_are_refused_by_name(values, word):
    with pytest.raises(InputError, match=word) as error:
        arrays.as_points(values, "molar.ply", dim=3)
    assert "molar.ply" in str(error.value)


def test_extremes_are_those_of_each_coordinate():
    low, high = arrays.extremes(np.array([[3, -1], [0, 5], [2, 2]]))
    assert (low.tolist(), high.tolist()) == ([0, -1], [3, 5])


def test_weights():
    assert arrays.as_weights(None, "w", num=3).tolist() == [1, 1, 1]
    for wrong in ([1, -1, 1], [0, 0, 0], [1, 1], [1, np.nan, 1]):
        with pytest.raises(InputError, match="w:"):
            arrays.as_weights(wrong, "w", num=3)


def test_masks_and_indices():
    assert arrays.as_mask([[1, 0]], "m", shape=(1, 2)).tolist() == [[True, False]]
    with pytest.raises(InputError, match="booleans"):
        arrays.as_mask([[2, 0]], "m", shape=(1, 2))
    with pytest.raises(InputError, match="shape"):
        arrays.as_mask([[1, 0]], "m", shape=(2, 1))
    assert arrays.as_indices([-1, 2], "i", lower=-1, upper=3).tolist() == [-1, 2]


def test_rotations_whose_squares_overflow_are_refused():
    with pytest.raises(InputError, match="not orthogonal"):
        arrays.as_rotations(np.array([[1e200, 1e200], [1e200, -1e200]]), "R")


def test_one_reflection_among_rotations_is_refused_and_so_is_a_matrix_that_is_slightly_off():
    both = np.stack([np.eye(3), np.diag([1.0, 1.0, -1.0])])
    assert len(arrays.as_rotations(both, "R", group="O")) == 2
    with pytest.raises(InputError, match="square"):
        arrays.as_rotations(np.ones((2, 3)), "R")
    with pytest.raises(InputError, match="contains a reflection"):
        arrays.as_rotations(both, "R", group="SO")
    with pytest.raises(InputError, match="not orthogonal"):
        arrays.as_rotations(np.eye(3) * (1.0 + 1e-5), "R")
    assert arrays.as_rotations(np.eye(3) * (1.0 + 1e-8), "R").shape == (3, 3)


def test_rows_are_summed_by_their_owners():
    rows = np.arange(6.0).reshape(3, 2)
    found = arrays.sums_by_owner(rows, np.array([2, 0, 2]), 4)
    np.testing.assert_array_equal(found, [[2, 3], [0, 0], [4, 6], [0, 0]])
