"""Surfaces that one direction saw, such as depth images: from where, and what that tells of the space before them.

A depth image says more than where a surface is. Between the surface and what saw it, there is nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray

#: Directions of a half sphere that a surface may have been seen from, and points around one that say where it ends.
NUM_DIRECTIONS, NUM_AROUND = 500, 20
#: A surface was seen from one direction if at most 3 % of its normals are steeper than this cosine, and at most this
#: share of its points lie behind others; such a share weighs so much against cosines where a direction is chosen.
STEEPEST_SEEN, MOST_HIDDEN, HIDDEN_WEIGHT = 0.15, 0.1, 3.0
#: Directions that are no worse than the best one by this are possible, too, this cosine apart.
SIGHT_SLACK, SIGHT_COSINE = 0.05, 0.98
#: A point is in front of what was seen if it is so many cells nearer than all that was seen within a cell around.
FRONT_CELLS = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthImage:
    """How near a surface comes to what saw it, by pixels of a cell.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Rows: two across the line of sight, then the line of sight, towards what saw the surface.
    corner : ndarray, shape (2,)
        Of the first pixel, along the first two axes.
    heights : ndarray, shape (h, w)
        The most along the line of sight within a pixel and its neighbours; infinite where nothing was seen.
    cell : float
        Side of a pixel.
    """

    axes: FloatArray
    corner: FloatArray
    heights: FloatArray
    cell: float

    @classmethod
    def along(cls, sight: FloatArray, points: FloatArray, cell: float) -> DepthImage:
        """Return the depth image of points (l, 3) along a unit direction (3,) towards what saw them."""
        axes = np.concatenate([np.linalg.svd(sight[None])[2][1:], sight[None]])
        along = points @ axes.T
        corner = along[:, :2].min(axis=0) - cell
        pixels = np.floor((along[:, :2] - corner) / cell).astype(np.int64)
        heights = np.full(pixels.max(axis=0) + 2, -np.inf)
        np.maximum.at(heights, tuple(pixels.T), along[:, 2])
        heights = maximum_filter(heights, size=3, mode="constant", cval=-np.inf)
        heights[np.isneginf(heights)] = np.inf
        return cls(axes=axes, corner=corner, heights=heights, cell=cell)

    def share_in_front(self, points: FloatArray) -> FloatArray:
        """Return the share of points (p, n, 3) that would have been seen instead of what was, shape (p,)."""
        along = points @ self.axes.T
        pixels = np.floor((along[..., :2] - self.corner) / self.cell).astype(np.int64)
        inside = ((pixels >= 0) & (pixels < self.heights.shape)).all(axis=-1)
        pixels[~inside] = 0
        seen = self.heights[pixels[..., 0], pixels[..., 1]]
        return np.asarray((inside & (along[..., 2] > seen + FRONT_CELLS * self.cell)).mean(axis=1))


def lines_of_sight(points: FloatArray, normals: FloatArray, spacing: float) -> FloatArray:
    """Return unit directions (s, 3) from which all of a surface is seen, as in a depth image, the likeliest first.

    Those that the steepest normals are not steep to, and from which hardly a point is behind others. Of a direction
    and its opposite it is the one from which the surface slopes down where it ends.

    Parameters
    ----------
    points, normals : ndarray, shape (l, 3)
        Unit normals; their signs do not matter.
    spacing : float
        Distance of the points.
    """
    numbers = np.arange(NUM_DIRECTIONS) + 0.5
    heights = 1.0 - numbers / NUM_DIRECTIONS
    angles, radii = np.pi * (1.0 + np.sqrt(5.0)) * numbers, np.sqrt(1.0 - heights**2)
    directions = np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=1)
    cosines = np.quantile(np.abs(normals @ directions.T), 0.03, axis=0)
    possible = np.flatnonzero(cosines >= STEEPEST_SEEN)
    if not len(possible):
        return np.empty((0, 3))
    directions = directions[possible]
    hidden = np.array([_share_hidden(points, normals, direction, spacing) for direction in directions])
    scores = cosines[possible] - HIDDEN_WEIGHT * hidden
    best = int(np.argmax(scores))
    if hidden[best] > MOST_HIDDEN:
        return np.empty((0, 3))
    near = directions[scores >= scores[best] - SIGHT_SLACK]
    sights = directions[[best]]
    while (cosines := np.abs(near @ sights.T).max(axis=1)).min() <= SIGHT_COSINE:
        sights = np.concatenate([sights, near[[int(cosines.argmin())]]])
    arms = points - points[cKDTree(points).query(points, k=min(NUM_AROUND, len(points)))[1]].mean(axis=1)
    slopes = normals * np.sign(normals @ sights[0])[:, None]
    falling = np.vdot(slopes, arms) - (slopes @ sights[0]) @ (arms @ sights[0])
    return sights * np.where(sights @ sights[0] < 0.0, -1.0, 1.0)[:, None] * (1.0 if falling >= 0 else -1.0)


def _share_hidden(points: FloatArray, normals: FloatArray, sight: FloatArray, spacing: float) -> float:
    """Return the share of points farther behind the foremost one of a pixel than their slope explains."""
    along = points @ np.linalg.svd(sight[None])[2].T
    pixels = np.floor((along[:, 1:] - along[:, 1:].min(axis=0)) / spacing).astype(np.int64)
    keys = pixels[:, 0] * (pixels[:, 1].max() + 1) + pixels[:, 1]
    depth = points @ sight
    front = np.full(keys.max() + 1, -np.inf)
    np.maximum.at(front, keys, depth)
    return float((front[keys] - depth > 2.0 * spacing / np.maximum(np.abs(normals @ sight), 0.1)).mean())
