"""Carries landmarks from the specimens that have them to others, along dense correspondences, and fuses several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.confidence.radius_model import spread
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.surface.closest import SurfaceLocator, SurfacePoints

#: Landmarks farther than this from their specimen's surface and from its copy of the mean, in parts of the root mean
#: square radius, are inside it or outside it: they keep their offset instead of being put onto the surface.
OFF_SURFACE = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Template:
    """One specimen with landmarks.

    Attributes
    ----------
    shape : int
        Its row in the dense correspondence.
    places : SurfacePoints
        Where its landmarks are on the mean; row for row those of ``landmarks``, anything where there is none.
    offsets : ndarray, shape (l, 3)
        From the registered mean to each landmark, zero for landmarks on the surface; NaN where there is none.
    trust : ndarray, shape (l,)
        How far each landmark counts, see :func:`collalign.template_landmarks.consensus.template_trust`.
    """

    shape: int
    places: SurfacePoints
    offsets: FloatArray
    trust: FloatArray

    def only(self, rows: Sequence[int]) -> Template:
        """Return the template with some of its landmarks."""
        chosen = list(rows)
        places = SurfacePoints(
            corners=self.places.corners[chosen], weights=self.places.weights[chosen]
        )
        return replace(self, places=places, offsets=self.offsets[chosen], trust=self.trust[chosen])


def template(
    shape: int,
    landmarks: FloatArray,
    vertices: FloatArray,
    faces: IntArray,
    radius: float,
    surface: SurfaceLocator,
) -> Template:
    """Find the places of a specimen's landmarks on its copy of the mean.

    Parameters
    ----------
    shape : int
    landmarks : ndarray, shape (l, 3)
        In the common frame; NaN where missing.
    vertices, faces : ndarray
        The copy.
    radius : float
        Root mean square radius of the mean.
    surface : SurfaceLocator
        Of the specimen itself.
    """
    known = np.asarray(np.isfinite(landmarks).all(axis=1))
    points = np.where(known[:, None], landmarks, vertices[0])
    places = SurfaceLocator(vertices, faces).closest(points)
    offsets = points - places.on(vertices)
    gaps = np.linalg.norm(offsets, axis=1)
    heights = np.linalg.norm(points - surface.closest(points).on(surface.vertices), axis=1)
    is_on = np.minimum(gaps, heights) <= OFF_SURFACE * radius
    offsets[is_on] = 0.0
    offsets[~known] = np.nan
    return Template(shape=shape, places=places, offsets=offsets, trust=known.astype(float))


def carried(templates: Sequence[Template], vertices: FloatArray) -> FloatArray:
    """Return where each template says that the landmarks are, shape (t, l, 3); NaN where it has none.

    Parameters
    ----------
    templates : sequence of Template
    vertices : ndarray, shape (v, 3)
        The mean's vertices on the specimen.
    """
    return np.stack([item.places.on(vertices) + item.offsets for item in templates])


def at_places(templates: Sequence[Template], values: FloatArray) -> FloatArray:
    """Return values of the mean's vertices at every template's landmarks, shape (t, l)."""
    return np.stack(
        [(item.places.weights * values[item.places.corners]).sum(axis=1) for item in templates]
    )


def off_surface(templates: Sequence[Template]) -> BoolArray:
    """Return which landmarks are inside or outside the surface in most templates that have them, shape (l,)."""
    off = np.stack([np.linalg.norm(item.offsets, axis=1) for item in templates])
    return np.asarray(np.nanmedian(np.where(np.isnan(off).all(axis=0), 0.0, off), axis=0) > 0)


def on_surface(
    points: FloatArray, templates: Sequence[Template], surface: SurfaceLocator
) -> FloatArray:
    """Return fused landmarks on a specimen's surface, shape (l, 3).

    A landmark that is off the surface in most templates stays off it.
    """
    known = np.isfinite(points).all(axis=1) & ~off_surface(templates)
    placed = np.array(points)
    if known.any():
        placed[known] = surface.closest(points[known]).on(surface.vertices)
    return placed


#: A template without any counterpart at a landmark still counts so much; one that corresponds perfectly counts 1.
_LEAST_QUALITY = 0.1


def template_weights(
    templates: Sequence[Template], specimen: int, vertices: FloatArray, quality: FloatArray
) -> FloatArray:
    """Weigh templates for one specimen, shape (t, l); each landmark's weights sum to one, zero where unknown.

    A weight is the quality of the registration at the landmark, on template and specimen, over the mean squared
    distance of the two shapes' corresponding points: deformations that have to go less far err less. It is multiplied
    by the trust in the template, unless no template is trusted there.

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
    weights = _LEAST_QUALITY + np.sqrt(np.stack(rows) * here)
    squares = _squared_distances(templates, specimen, vertices)
    largest = float(squares.max())
    weights /= np.maximum(squares / largest, np.finfo(float).eps)[:, None] if largest > 0 else 1.0
    return _shares(weights * _counted(templates))


def mean_of_trusted(templates: Sequence[Template], values: FloatArray) -> FloatArray:
    """Return the mean of values (t, l) of templates, each as far as it is trusted, shape (l,); NaN where none is."""
    weights = _shares(_counted(templates))
    total = (np.where(weights > 0, values, 0.0) * weights).sum(axis=0)
    return np.where(weights.any(axis=0), total, np.nan)


def _counted(templates: Sequence[Template]) -> FloatArray:
    """Return the trust in each template, shape (t, l); where none is trusted, all that have the landmark count."""
    trust = np.stack([item.trust for item in templates])
    known = np.stack([np.isfinite(item.offsets).all(axis=1) for item in templates])
    return np.where(trust.any(axis=0), trust, known)


def _shares(weights: FloatArray) -> FloatArray:
    """Return weights (t, l) of which each landmark's sum to one, but where all are zero."""
    total = weights.sum(axis=0)
    return np.asarray(weights / np.where(total > 0, total, 1.0))


def template_distance(templates: Sequence[Template], specimen: int, vertices: FloatArray) -> float:
    """Return the root of the harmonic mean of mean squared distances of a specimen (v, 3) from its templates."""
    squares = _squared_distances(templates, specimen, vertices)
    return float(np.sqrt(1.0 / np.mean(1.0 / squares))) if squares.all() else 0.0


def _squared_distances(
    templates: Sequence[Template], specimen: int, vertices: FloatArray
) -> FloatArray:
    """Return the mean squared distance of corresponding points of the specimen and each template, shape (t,)."""
    squares = [((vertices[item.shape] - vertices[specimen]) ** 2).sum(axis=1) for item in templates]
    return np.array([one[np.isfinite(one)].mean() for one in squares])


def fuse(said: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted mean of what templates say about a specimen, and its spread.

    Parameters
    ----------
    said : ndarray, shape (t, l, 3)
        See :func:`carried`.
    weights : ndarray, shape (t, l)
        See :func:`template_weights`.

    Returns
    -------
    points : ndarray, shape (l, 3)
        Before they are put onto the surface; NaN where no template has the landmark, or the specimen no such place.
    spreads : ndarray, shape (l,)
    """
    filled = np.where(weights[..., None] > 0, said, 0.0)
    points = (weights[..., None] * filled).sum(axis=0)
    points[weights.sum(axis=0) == 0] = np.nan
    return points, spread(said, weights)
