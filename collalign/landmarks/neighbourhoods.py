"""What the surface around a landmark shows of its error: how alike it is on both shapes, and how flat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from collalign.landmarks.carry import Template
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.surface_points import NUM_NEIGHBOURS, plane_normals
from data_tools.rotations import nearest_orthogonal
from data_tools.surface.normals import vertex_normals

#: Radius of the neighbourhoods in which normals are compared, in root mean square radii; relief is that of half.
_WIDE = 0.5


class Neighbourhoods:
    """Neighbourhoods of landmarks on all shapes, by a dense correspondence.

    Parameters
    ----------
    mean : ndarray, shape (v, 3)
    copies : ndarray, shape (N, v, 3)
        The mean's vertices on each shape, none missing.
    faces : ndarray of int, shape (f, 3)
    unit : float
        Root mean square radius of the mean.
    """

    def __init__(self, mean: FloatArray, copies: FloatArray, faces: IntArray, unit: float) -> None:
        self._mean, self._copies, self._faces, self._unit = mean, copies, faces, unit
        self._tree, self._normals = cKDTree(mean), dict[int, FloatArray]()

    def compare(self, templates: Sequence[Template], specimen: int) -> tuple[FloatArray, FloatArray]:
        """Return what the surroundings of landmarks show, on average over templates, shapes (l,) and (l,).

        Returns
        -------
        tilt : ndarray, shape (l,)
            Root mean square difference of normals, template and specimen laid onto each other there.
        relief : ndarray, shape (l,)
            How far the template's surface reaches from its plane there (standard deviation), in radii. On a flat
            place nothing holds a landmark.
        """
        found = np.array([self._of_template(one, specimen) for one in templates])
        known = np.stack([np.isfinite(one.offsets).all(axis=1) for one in templates])[:, None]
        total = np.where(known, found, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        tilt, relief = np.where(known.any(axis=0), total, np.nan)
        return read_only(tilt), read_only(relief)

    def _of_template(self, item: Template, specimen: int) -> FloatArray:
        """Tilts and reliefs of one template's landmarks, shape (2, l)."""
        places, source, target = item.places.on(self._mean), self._copies[item.shape], self._copies[specimen]
        normals = [self._normals_of(shape) for shape in (item.shape, specimen)]
        tilts, reliefs = [], []
        for wide, narrow in zip(self._around(places, _WIDE), self._around(places, _WIDE / 2.0), strict=True):
            here, there = (points[wide] - points[wide].mean(axis=0) for points in (source, target))
            rotated = normals[1][wide] @ nearest_orthogonal(here.T @ there, determinant=1.0).T
            cosines = np.abs((normals[0][wide] * rotated).sum(axis=1))
            tilts.append(np.sqrt(np.mean(2.0 - 2.0 * np.minimum(cosines, 1.0))))
            reliefs.append(np.linalg.svd(source[narrow] - source[narrow].mean(axis=0), compute_uv=False)[-1])
            reliefs[-1] /= np.sqrt(len(narrow)) * self._unit
        return np.array([tilts, reliefs])

    def _around(self, places: FloatArray, radius: float) -> list[IntArray]:
        """Vertices of the mean around each place, at least the nearest few."""
        nearest = self._tree.query(places, k=min(NUM_NEIGHBOURS, len(self._mean)))[1]
        near = self._tree.query_ball_point(places, radius * self._unit)
        return [np.union1d(few, many).astype(np.int64) for few, many in zip(nearest, near, strict=True)]

    def _normals_of(self, shape: int) -> FloatArray:
        if shape not in self._normals:
            points = self._copies[shape]
            normals = vertex_normals(points, self._faces) if len(self._faces) else plane_normals(points, points)
            self._normals[shape] = normals
        return self._normals[shape]
