"""How far a map can be trusted, whole and at each point: what its evidence and the other candidates say of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.confidence.map_model import FLOOR, LEAST_AGREEMENT, NEAR, map_probability, point_probability
from collalign.nonrigid.portfolio import Refined
from collalign.nonrigid.spectral_shape import SpectralShape
from data_tools.arrays import FloatArray

#: Difference of scores at which a candidate counts e times as much as another. Chosen on 19 pairs of SCAPE,
#: centaurs, cats and dogs, ants, glasses, teddies, and humans and armadillos: .2 to .5 lead to mean errors of .10 to
#: .11, the best score alone to .17.
SCORE_SCALE = 0.35
#: Candidates that take this share of the points to the same places are no rivals; a lead is not counted as larger.
SAME_SHARE, MOST_LEAD = 0.8, 2.0


def agreements(target: SpectralShape, found: Sequence[Refined]) -> FloatArray:
    """Return the mean share of points that the candidates, weighed by score, take near to where each one does, (m,).

    Starts lead to the true map from many sides, and to each wrong one from few.
    """
    weights = _weights(found)
    return np.array([(weights @ _same_places(target, found, number)).mean() for number in range(len(found))])


def map_terms(target: SpectralShape, found: Sequence[Refined], number: int) -> FloatArray:
    """Return what :func:`map_probability` weighs of a candidate, shape (3,).

    Parameters
    ----------
    target : SpectralShape
    found : sequence of Refined
        All candidates, also those that are shown to nobody.
    number : int
        The candidate's position.
    """
    scores = np.array([one.score for one in found])
    same = _same_places(target, found, number)
    rivals = scores[same.mean(axis=1) < SAME_SHARE]
    lead = float(rivals.min() - scores[number]) if len(rivals) else MOST_LEAD
    agreement = float((_weights(found) @ same).mean())
    commutativity = max(found[number].evidence.commutativity, FLOOR)
    return np.array([agreement, np.clip(lead, -MOST_LEAD, MOST_LEAD), -np.log(commutativity)])


def trust_of(target: SpectralShape, source: SpectralShape, found: Sequence[Refined]) -> tuple[float, FloatArray]:
    """Return the confidence of the first candidate, and that of its image of each working vertex of the source.

    Returns
    -------
    confidence : float
    vertex_confidence : ndarray, shape (w,)
        That of the nearest dense sample.
    """
    knows_sides = bool(np.isfinite(found[0].evidence.orientation))
    whole = map_probability(map_terms(target, found, 0), knows_sides=knows_sides)
    at_samples = point_probability(point_terms(target, source, found, 0), whole, knows_sides=knows_sides)
    return whole, at_samples[source.nearest_dense]


def point_terms(target: SpectralShape, source: SpectralShape, found: Sequence[Refined], number: int) -> FloatArray:
    """Return what :func:`point_probability` weighs of a candidate at the source's dense samples, shape (s, 2)."""
    forward = found[number].functional_map.map_target_source
    backward = found[number].functional_map.map_source_target
    points = source.vertices[source.dense]
    returned = np.linalg.norm(points[backward[forward]] - points, axis=1) / source.area**0.5
    agreement = _weights(found) @ _same_places(target, found, number)
    return np.column_stack([np.log(LEAST_AGREEMENT + agreement), -np.log(0.1 * NEAR + returned)])


def _same_places(target: SpectralShape, found: Sequence[Refined], number: int) -> FloatArray:
    """Return which points each candidate takes near to where one of them does, shape (candidates, s), as 0 and 1."""
    places = target.vertices[target.dense] / target.area**0.5
    images = np.stack([places[one.functional_map.map_target_source] for one in found])
    return (np.linalg.norm(images - images[number], axis=2) <= NEAR).astype(np.float64)


def _weights(found: Sequence[Refined]) -> FloatArray:
    """Return how much each candidate counts by its score, together 1."""
    scores = np.array([one.score for one in found])
    weights = np.exp((scores.min() - scores) / SCORE_SCALE)
    return np.asarray(weights / weights.sum())
