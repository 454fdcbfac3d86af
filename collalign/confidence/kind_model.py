"""How likely two shapes are of one kind, and how sure it is that two groups of shapes are not.

A conditional statement about one pair is weak: guns of three game packs match each other as badly as birds match
planes. What tells kinds apart is that the nearest kin is far closer than the nearest stranger.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray

#: Log-odds that two shapes are of one kind: a constant, and the weights of the least mismatch of their
#: neighbourhoods at any of their poses, and of the logarithms of two distances that no pose changes
#: (:func:`collalign.stages.kinds.pose_free.kind_descriptors`). A logistic model.
CONSTANT, MISMATCH, SHELLS, DESCRIPTOR = 6.9, -11.6, -1.3, -0.6
#: The same before two shapes are matched: by the two distances alone.
FREE_CONSTANT, FREE_SHELLS, FREE_DESCRIPTOR = -6.4, -2.5, -1.8
#: Distances count as no smaller than this: copies.
LEAST_DISTANCE = 0.02
#: Two groups are of different kinds only if the log-odds of their nearest members are below this on average, ...
MOST_ALIKE = 1.0
#: ... and the mean log-odds of the nearest kin within each are above those by this, and by :data:`FEW` over the
#: members of the smaller group: single shapes may be odd.
LEAST_GAP, FEW = 2.6, 2.0
#: The same before pairs are matched, where a second look follows.
LEAST_FREE_GAP = 1.0
#: The odds that two groups are of different kinds: even at a gap of :data:`EVEN_GAP`, and e times as much for each
#: unit of :data:`UNIT_GAP`.
EVEN_GAP, UNIT_GAP = 1.2, 0.9


def kin_log_odds(
    shells: FloatArray, descriptors: FloatArray, mismatches: FloatArray | None = None
) -> FloatArray:
    """Return the log-odds that pairs of shapes are of one kind, of the shape of the arguments.

    Parameters
    ----------
    shells, descriptors : ndarray
        Distances of the two descriptors of each pair.
    mismatches : ndarray, optional
        Least mismatch of each pair; without, the distances alone decide.
    """
    logs = (np.log(np.maximum(one, LEAST_DISTANCE)) for one in (shells, descriptors))
    of_shells, of_descriptors = logs
    if mismatches is None:
        return FREE_CONSTANT + FREE_SHELLS * of_shells + FREE_DESCRIPTOR * of_descriptors
    known = CONSTANT + SHELLS * of_shells + DESCRIPTOR * of_descriptors
    return np.asarray(known + MISMATCH * mismatches)


def split_confidence(gap: float) -> float:
    """Return how likely two groups with this gap, less what :data:`FEW` asks for, are of different kinds."""
    return float(1.0 / (1.0 + np.exp(-(gap - EVEN_GAP) / UNIT_GAP)))
