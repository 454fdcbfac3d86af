"""Measures of a stated confidence: calibration, ranking, and runs that are wrong without a word."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.errors import InputError

#: Bins of the reliability diagram.
NUM_BINS = 10
#: What is stated at this confidence should be right, and what is right should be stated at that.
SURE, USABLE = 0.95, 0.9


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagram:
    """A reliability diagram (Niculescu-Mizil and Caruana 2005), bins of equal width.

    Attributes
    ----------
    stated : ndarray, shape (NUM_BINS,)
        Mean confidence of each bin; NaN where it is empty.
    right : ndarray, shape (NUM_BINS,)
        Share that is right.
    count : ndarray of int, shape (NUM_BINS,)
    """

    stated: FloatArray
    right: FloatArray
    count: IntArray

    @property
    def expected_error(self) -> float:
        """Expected calibration error (Naeini et al. 2015): mean absolute difference, weighted by the bins' counts."""
        filled = self.count > 0
        gaps = np.abs(self.stated[filled] - self.right[filled])
        return float(gaps @ self.count[filled] / self.count.sum())

    @property
    def worst_excess(self) -> float:
        """Largest stated minus right of a bin."""
        filled = self.count > 0
        return float((self.stated[filled] - self.right[filled]).max())


def reliability(stated: ArrayLike, right: ArrayLike) -> Diagram:
    """Return the reliability diagram of confidences.

    Parameters
    ----------
    stated : array_like, shape (n,)
        In [0, 1].
    right : array_like of bool, shape (n,)

    Raises
    ------
    InputError
        If there is nothing, or a confidence is outside [0, 1].
    """
    p, y = _checked(stated, right)
    bins = np.minimum((p * NUM_BINS).astype(np.int64), NUM_BINS - 1)
    count = np.bincount(bins, minlength=NUM_BINS)
    with np.errstate(invalid="ignore"):
        return Diagram(
            stated=np.bincount(bins, p, NUM_BINS) / count,
            right=np.bincount(bins, y, NUM_BINS) / count,
            count=count,
        )


def auc_within(stated: ArrayLike, right: ArrayLike, run: ArrayLike) -> float:
    """Return the chance that a right shape is ranked above a wrong one of the same run; ties count one half.

    Runs without right or without wrong shapes say nothing; NaN if there is no other.
    """
    p, y = _checked(stated, right)
    runs = np.asarray(run)
    wins = comparisons = 0.0
    for one in np.unique(runs):
        good, bad = p[(runs == one) & y], p[(runs == one) & ~y]
        wins += (good[:, None] > bad).sum() + 0.5 * (good[:, None] == bad).sum()
        comparisons += len(good) * len(bad)
    return float(wins / comparisons) if comparisons else float("nan")


def unnoticed_runs(wrong: BoolArray, named: BoolArray, run: ArrayLike) -> float:
    """Return the share of runs with a wrong shape that is neither in doubt nor named by a note."""
    runs = np.asarray(run)
    if not len(runs):
        raise InputError("no shape at all")
    bad = {one for one, w, n in zip(runs.tolist(), wrong, named, strict=True) if w and not n}
    return len(bad) / len(set(runs.tolist()))


def right_above(stated: ArrayLike, right: ArrayLike, threshold: float) -> tuple[float, int]:
    """Return the share that is right of what is stated with at least this confidence (NaN if none), and how many."""
    p, y = _checked(stated, right)
    sure = p >= threshold
    return (float(y[sure].mean()) if sure.any() else float("nan")), int(sure.sum())


def _checked(stated: ArrayLike, right: ArrayLike) -> tuple[FloatArray, BoolArray]:
    p, y = np.asarray(stated, dtype=np.float64), np.asarray(right, dtype=bool)
    if not len(p) or p.shape != y.shape or not np.all((p >= 0) & (p <= 1)):
        raise InputError(
            f"stated, right: expected confidences in [0, 1] and as many truths, got {len(p)} and {len(y)}"
        )
    return p, y
