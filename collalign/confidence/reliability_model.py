"""What share of poses is right that are stated at some confidence: measured, so that filters keep their word."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray

#: From which confidence on a share holds, and the share that is right (within 30 degrees, modulo symmetry), of the
#: development sets of ``python -m experiments scoreboard``.
STEPS = (0.0, 0.5, 0.9, 0.95, 0.99, 0.995)
RIGHT = (0.688, 0.839, 0.934, 0.985, 0.985, 0.998)


def expected_right(confidence: FloatArray) -> FloatArray:
    """Return how likely poses are right by what they are stated at, shape (n,); NaN where nothing is stated.

    Parameters
    ----------
    confidence : ndarray, shape (n,)
        In [0, 1], or NaN.
    """
    known = ~np.isnan(confidence)
    found = np.full(len(confidence), np.nan)
    # Confidences come in steps of rounding: .995 may be stored as a little less.
    step = np.searchsorted(STEPS, confidence[known] + np.finfo(np.float32).eps, side="right") - 1
    found[known] = np.array(RIGHT)[np.maximum(step, 0)]
    return found
