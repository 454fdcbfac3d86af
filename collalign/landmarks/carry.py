"""Carries landmarks from the specimens that have them to one that has not, along a dense correspondence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.surface.closest import SurfaceLocator, SurfacePoints

#: Landmarks farther than this from their specimen's surface, in parts of the root mean square radius, are inside it
#: or beside it: they keep their offset instead of being put onto the surface.
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
    """

    shape: int
    places: SurfacePoints
    offsets: FloatArray

    def only(self, rows: Sequence[int]) -> Template:
        """Return the template with some of its landmarks."""
        chosen = list(rows)
        places = SurfacePoints(corners=self.places.corners[chosen], weights=self.places.weights[chosen])
        return Template(shape=self.shape, places=places, offsets=self.offsets[chosen])


def template(shape: int, landmarks: FloatArray, vertices: FloatArray, faces: IntArray, radius: float) -> Template:
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
    """
    known = np.asarray(np.isfinite(landmarks).all(axis=1))
    points = np.where(known[:, None], landmarks, vertices[0])
    places = SurfaceLocator(vertices, faces).closest(points)
    offsets = points - places.on(vertices)
    offsets[np.linalg.norm(offsets, axis=1) <= OFF_SURFACE * radius] = 0.0
    offsets[~known] = np.nan
    return Template(shape=shape, places=places, offsets=offsets)


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
    return np.stack([(item.places.weights * values[item.places.corners]).sum(axis=1) for item in templates])


def off_surface(templates: Sequence[Template]) -> BoolArray:
    """Return which landmarks are inside or beside the surface in most templates that have them, shape (l,)."""
    off = np.stack([np.linalg.norm(item.offsets, axis=1) for item in templates])
    return np.asarray(np.nanmedian(np.where(np.isnan(off).all(axis=0), 0.0, off), axis=0) > 0)


def on_surface(points: FloatArray, templates: Sequence[Template], surface: SurfaceLocator) -> FloatArray:
    """Return fused landmarks on a specimen's surface, shape (l, 3).

    A landmark that is off the surface in most templates stays off it.
    """
    known = np.isfinite(points).all(axis=1) & ~off_surface(templates)
    placed = np.array(points)
    if known.any():
        placed[known] = surface.closest(points[known]).on(surface.vertices)
    return placed
