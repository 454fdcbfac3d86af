"""What share of poses is right that are stated at some confidence: measured, so that filters keep their word."""

from __future__ import annotations

from importlib import resources

import numpy as np

from data_tools.arrays import FloatArray

#: The table of both numbers, which ``python -m experiments scoreboard`` writes.
FILE = "reliability.csv"
#: From which confidence on a share holds, and the share that is right (within 30 degrees, modulo symmetry), of the
#: development sets of that command.
STEPS, RIGHT = np.loadtxt(
    resources.files("collalign.confidence").joinpath(FILE).read_text("utf-8").splitlines()[1:],
    delimiter=",",
    unpack=True,
)


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
    found[known] = RIGHT[np.maximum(step, 0)]
    return found
