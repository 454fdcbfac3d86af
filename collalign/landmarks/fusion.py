"""One answer from several templates, weighted by how near each is to the specimen and how well it is registered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.confidence.radius_model import spread
from collalign.landmarks.carry import Template, at_places, carried
from data_tools.arrays import FloatArray

#: A template without any counterpart at a landmark still counts so much, beside one that corresponds perfectly.
_LEAST_QUALITY = 0.1


def template_weights(
    templates: Sequence[Template], specimen: int, vertices: FloatArray, quality: FloatArray
) -> FloatArray:
    """Weigh templates for one specimen, shape (t, l); each landmark's weights sum to one, zero where unknown.

    A weight is the quality of the registration at the landmark, on template and specimen, over the mean squared
    distance of the two shapes' corresponding points: deformations that have to go less far err less.

    Parameters
    ----------
    templates : sequence of Template
    specimen : int
        Its row.
    vertices : ndarray, shape (N, v, 3)
        Dense correspondence; NaN where a shape has nothing.
    quality : ndarray, shape (N, v)
    """
    here = at_places(templates, quality[specimen])
    rows = [at_places([item], quality[item.shape])[0] for item in templates]
    trust = _LEAST_QUALITY + np.sqrt(np.stack(rows) * here)
    squares = _squared_distances(templates, specimen, vertices)
    largest = float(squares.max())
    trust /= np.maximum(squares / largest, np.finfo(float).eps)[:, None] if largest > 0 else 1.0
    trust *= np.stack([np.isfinite(item.offsets).all(axis=1) for item in templates])
    total = trust.sum(axis=0)
    return np.asarray(trust / np.where(total > 0, total, 1.0))


def template_distance(templates: Sequence[Template], specimen: int, vertices: FloatArray) -> float:
    """Return the root of the harmonic mean of mean squared distances of a specimen (v, 3) from its templates."""
    squares = _squared_distances(templates, specimen, vertices)
    return float(np.sqrt(1.0 / np.mean(1.0 / squares))) if squares.all() else 0.0


def _squared_distances(templates: Sequence[Template], specimen: int, vertices: FloatArray) -> FloatArray:
    """Return the mean squared distance of corresponding points of the specimen and each template, shape (t,)."""
    squares = [((vertices[item.shape] - vertices[specimen]) ** 2).sum(axis=1) for item in templates]
    return np.array([one[np.isfinite(one)].mean() for one in squares])


def fuse(
    templates: Sequence[Template], specimen: int, vertices: FloatArray, quality: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted mean of what templates say about a specimen, and its spread.

    Returns
    -------
    points : ndarray, shape (l, 3)
        Before they are put onto the surface; NaN where no template has the landmark, or the specimen no such place.
    spreads : ndarray, shape (l,)
    """
    said = carried(templates, vertices[specimen])
    weights = template_weights(templates, specimen, vertices, quality)
    filled = np.where(weights[..., None] > 0, said, 0.0)
    points = (weights[..., None] * filled).sum(axis=0)
    points[weights.sum(axis=0) == 0] = np.nan
    return points, spread(said, weights)
