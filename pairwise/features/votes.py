"""Votes of pairs of points that look alike, counted one by one, and what has most of them, or lies nearest.

Compiled by Numba. NumPy's arrays of all alike pairs have millions of numbers each, it sorts all votes, and it copies
all distances once for either way.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import FloatArray, IntArray


@numba.njit(cache=True)
def counted_votes(
    alike: tuple[IntArray, IntArray, IntArray],
    first: tuple[IntArray, IntArray],
    turns: tuple[FloatArray, FloatArray],
    shape: tuple[int, int, int],
) -> tuple[FloatArray, FloatArray]:
    """Return the votes for each reference, place and step of a turn, and by how much they are beyond it, in sum.

    Parameters
    ----------
    alike : tuple of ndarray of int, shapes (p,), (p,) and (q,)
        Of each pair of the part, from where to where pairs of the whole look like it, in the order of the last one.
    first : pair of ndarray of int, shapes (p,) and (q,)
        The first points of the pairs of the part, and of the whole.
    turns : pair of ndarray, shapes (p,) and (q,)
        Of both, in radians.
    shape : (int, int, int)
        References, places and steps.
    """
    starts, ends, order = alike
    num_turns = shape[2]
    votes, beyond = np.zeros(shape), np.zeros(shape)
    for pair in range(len(starts)):
        # What many pairs of the whole look like, such as those of a plate, says little of each of them.
        weight = np.sqrt(1.0 / max(ends[pair] - starts[pair], 1))
        reference = first[0][pair]
        for k in range(starts[pair], ends[pair]):
            other = order[k]
            turn = (turns[1][other] - turns[0][pair]) / (2.0 * np.pi) * num_turns
            step = np.floor(turn)
            place, box = first[1][other], int(step) % num_turns
            votes[reference, place, box] += weight
            beyond[reference, place, box] += weight * (turn - step)
    return votes, beyond


@numba.njit(cache=True)
def most_voted(votes: FloatArray, num: int) -> IntArray:
    """Return where each row (n, m) has the most votes, shape (n, num), the most first; of equal ones the first."""
    found = np.zeros((len(votes), num), dtype=np.int64)
    for row in range(len(votes)):
        least = np.full(num, np.inf)
        for column in range(votes.shape[1]):
            value = -votes[row, column]
            if value < least[-1]:
                _insert(value, column, least, found[row])
    return found


@numba.njit(cache=True)
def least_both_ways(
    values: NDArray[np.float32], of_row: int, of_column: int
) -> tuple[IntArray, IntArray]:
    """Return where each row (n, m) has its least entries, (n, of_row), and each column, (m, of_column).

    The least one first; of equal ones the first. All are read once, as they lie in memory.
    """
    num_rows, num_columns = values.shape
    columns = np.zeros((num_rows, of_row), dtype=np.int64)
    rows = np.zeros((num_columns, of_column), dtype=np.int64)
    least_of_columns = np.full((num_columns, of_column), np.inf)
    for row in range(num_rows):
        least = np.full(of_row, np.inf)
        for column in range(num_columns):
            value = values[row, column]
            if value < least[-1]:
                _insert(value, column, least, columns[row])
            if value < least_of_columns[column, -1]:
                _insert(value, row, least_of_columns[column], rows[column])
    return columns, rows


@numba.njit(cache=True)
def _insert(value: float, place: int, least: FloatArray, places: IntArray) -> None:
    """Insert a value below the last of the least ones (k,) where it belongs, and its place among theirs."""
    at = len(least) - 1
    while at > 0 and value < least[at - 1]:
        least[at], places[at] = least[at - 1], places[at - 1]
        at -= 1
    least[at], places[at] = value, place
