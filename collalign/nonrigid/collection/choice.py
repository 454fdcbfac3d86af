"""Which of several candidate maps of each pair is right: its own evidence and agreement around cycles together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.confidence.map_model import FLOOR
from collalign.nonrigid.collection.bases import common_bases, map_residuals
from data_tools.arrays import FloatArray, IntArray

#: Log-odds that a candidate map loses per unit of the logarithm of its residual, the number of functions in which
#: candidates are compared, and rounds of choosing.
CYCLE_WEIGHT, NUM_COMPARED, MAX_ROUNDS = 4.0, 30, 8


def choose_maps(
    edges: IntArray, candidates: Sequence[FloatArray], log_odds: Sequence[FloatArray], num_shapes: int
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Choose one candidate map for each pair, and return the common bases of those.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
        They connect all shapes.
    candidates : sequence of E ndarray (m, k, k)
        ``C_source_target`` of each candidate, the likeliest first; k at least :data:`NUM_COMPARED` or the same for
        all.
    log_odds : sequence of E ndarray (m,)
        By the pair's own evidence, up to a constant of the pair.
    num_shapes : int

    Returns
    -------
    choice : ndarray of int, shape (E,)
    bases, residuals : ndarray
        Of the chosen maps in their lowest functions, see :func:`common_bases`.
    """
    size = min(NUM_COMPARED, *(maps.shape[-1] for maps in candidates))
    low = [maps[:, :size, :size] for maps in candidates]
    choice = np.array([int(np.argmax(odds)) for odds in log_odds])
    weights = np.array([_certainty(odds) for odds in log_odds])
    bases, residuals = _bases_of(edges, low, choice, num_shapes, weights)
    for _ in range(MAX_ROUNDS):
        gaps = [
            map_residuals(np.tile(edge, (len(maps), 1)), maps, bases) for edge, maps in zip(edges, low, strict=True)
        ]
        scores = [
            odds - CYCLE_WEIGHT * np.log(np.maximum(gap, FLOOR)) for odds, gap in zip(log_odds, gaps, strict=True)
        ]
        better = np.array([int(np.argmax(score)) for score in scores])
        if (better == choice).all():
            break
        choice = better
        bases, residuals = _bases_of(edges, low, choice, num_shapes, weights)
    return choice, bases, residuals


def _bases_of(
    edges: IntArray, maps: Sequence[FloatArray], choice: IntArray, num_shapes: int, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return common_bases(edges, np.stack([own[c] for own, c in zip(maps, choice, strict=True)]), num_shapes, weights)


def _certainty(log_odds: FloatArray) -> float:
    """Return the probability of the likeliest candidate against the others."""
    chances = np.exp(log_odds - log_odds.max())
    return float(1.0 / chances.sum())
