"""Error radii of carried landmarks: calibrated on the templates, each predicted from the others."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray

#: Share of landmarks that lie within their radius.
COVERAGE = 0.9
#: Fewest templates that anything can be calibrated on.
MIN_TEMPLATES = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What the templates say about errors.

    Attributes
    ----------
    landmark_error : ndarray, shape (l,)
        Root mean square error of each landmark when templates are predicted from each other.
    factor : float
        A radius is so many times the expected error; NaN where there are too few templates.
    num_scores : int
        Errors that the factor is a quantile of.
    """

    landmark_error: FloatArray
    factor: float
    num_scores: int


def calibrate(errors: FloatArray, spreads: FloatArray) -> Calibration:
    """Learn radii from templates that were left out in turn.

    The expected error of a landmark on a specimen is the root of the sum of two squares: this landmark's error on the
    other templates, and the spread of what the templates say there. The factor is the split-conformal quantile of
    error over expected error, where each error is expected without itself.

    Parameters
    ----------
    errors : ndarray, shape (t, l)
        Of each landmark on each template, predicted from the others; NaN where unknown.
    spreads : ndarray, shape (t, l)
        Of those predictions, see :func:`spread`.

    References
    ----------
    Lei, G'Sell, Rinaldo, Tibshirani and Wasserman, Distribution-free predictive inference for regression, JASA 113
    (2018), section 5.2 (locally weighted conformal inference). The scores of one specimen depend on each other, and
    specimens of another kind than the templates are not covered.
    """
    landmark_error = _rms(errors)
    if len(errors) < MIN_TEMPLATES:
        return Calibration(landmark_error=landmark_error, factor=math.nan, num_scores=0)
    others = np.stack([_rms(np.delete(errors, at, axis=0)) for at in range(len(errors))])
    scores = errors / np.hypot(others, spreads)
    scores = np.sort(scores[np.isfinite(scores)])
    rank = math.ceil((len(scores) + 1) * COVERAGE)
    factor = float(scores[rank - 1]) if rank <= len(scores) else math.nan
    return Calibration(landmark_error=landmark_error, factor=factor, num_scores=len(scores))


def radii(calibration: Calibration, spreads: FloatArray) -> FloatArray:
    """Return the radius of each landmark on a specimen, shape (l,); NaN where nothing was calibrated."""
    return np.asarray(calibration.factor * np.hypot(calibration.landmark_error, spreads))


def spread(said: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted standard deviation of what templates say about each landmark, shape (l,).

    Parameters
    ----------
    said : ndarray, shape (t, l, 3)
        NaN where a template says nothing.
    weights : ndarray, shape (t, l)
        Zero there; they sum to one for each landmark that any template knows.
    """
    filled = np.where(weights[..., None] > 0, said, 0.0)
    mean = (weights[..., None] * filled).sum(axis=0)
    squares = ((filled - mean) ** 2).sum(axis=2)
    return np.asarray(np.sqrt((weights * squares).sum(axis=0)))


def _rms(errors: FloatArray) -> FloatArray:
    """Root mean square over the rows that are known, shape (l,); NaN where none is."""
    known = np.isfinite(errors)
    counts = known.sum(axis=0)
    total = np.where(known, errors**2, 0.0).sum(axis=0)
    return np.asarray(np.sqrt(np.where(counts > 0, total / np.maximum(counts, 1), np.nan)))
