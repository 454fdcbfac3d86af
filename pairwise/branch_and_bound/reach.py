"""What every pose of a cell costs at least, by how far points move in it; compiled by Numba."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def reach_bounds(  # type: ignore[no-untyped-def]
    rotations, shifts, reaches, chords, source, lengths, target, constant, unmatched_cost, max_unmatched
):
    """Return the sum of the least costs of the source points, at most so many of them left out."""
    k, n = constant.shape
    bounds, savings, moved = np.empty(len(rotations)), np.empty(k), np.empty(3)
    for c in range(len(rotations)):
        total = 0.0
        for j in range(k):
            for a in range(3):
                moved[a] = shifts[c, a]
                for b in range(3):
                    moved[a] += rotations[c, a, b] * source[j, b]
            reach, least = reaches[c] + chords[c] * lengths[j], np.inf
            for i in range(n):
                squared = 0.0
                for a in range(3):
                    squared += (moved[a] - target[i, a]) ** 2
                gap = max(np.sqrt(squared) - reach, 0.0)
                least = min(least, gap * gap + constant[j, i])
            total += min(least, 1e300)
            savings[j] = max(least - unmatched_cost, 0.0)
        if max_unmatched >= k:
            total -= savings.sum()
        elif max_unmatched > 0:
            total -= np.sort(savings)[k - max_unmatched :].sum()
        bounds[c] = total
    return bounds
