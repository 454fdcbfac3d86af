"""Votes of pairs of points that look alike, counted one by one, and what has most of them.

Compiled by Numba. NumPy's arrays of all alike pairs have millions of numbers each, and it sorts all votes.
"""

from __future__ import annotations

import numba
import numpy as np

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
        most = np.full(num, -np.inf)
        for column in range(votes.shape[1]):
            vote = votes[row, column]
            if vote <= most[num - 1]:
                continue
            at = num - 1
            while at > 0 and vote > most[at - 1]:
                most[at], found[row, at] = most[at - 1], found[row, at - 1]
                at -= 1
            most[at], found[row, at] = vote, column
    return found
