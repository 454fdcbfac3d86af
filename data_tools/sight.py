"""Surfaces that one direction saw, such as depth images: from where, and what that tells of the space before them.

A depth image says more than where a surface is. Between the surface and what saw it, there is nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray


class SightTuning(NamedTuple):
    """Numbers by which a line of sight is found.

    Views of an armadillo, a teddy, a chair and a horse, and scans of a bunny, have cosines of .16 to .6 and up to
    7 % hidden points; planes, fish, birds, guitars, chairs and teeth as whole clouds are steeper or hide more.
    """

    least_points: int = 100
    """Fewer points tell nothing: their normals and what hides them are noise."""
    num_directions: int = 500
    """Directions of a half sphere that are tried."""
    num_around: int = 20
    """Points around one that say whether the surface ends there, and to which side."""
    steepest: float = 0.15
    """A surface was seen from one direction if at most 3 % of its normals are steeper than this cosine, ..."""
    most_hidden: float = 0.1
    """... and at most this share of its points lie behind others."""
    hidden_weight: float = 3.0
    """Such a share weighs so much against cosines where a direction is chosen."""
    slack: float = 0.05
    """Directions that are no worse than the best one by this are possible, too, ..."""
    apart: float = 0.98
    """... those that differ by this cosine."""
    front_cells: float = 1.5
    """A point is in front of what was seen if it is so many cells nearer than all that was seen in pixels around."""


#: The numbers in use.
TUNED = SightTuning()


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
        return np.asarray(
            (inside & (along[..., 2] > seen + TUNED.front_cells * self.cell)).mean(axis=1)
        )


def lines_of_sight(points: FloatArray, normals: FloatArray, spacing: float) -> FloatArray:
    """Return unit directions (s, 3) from which all of a surface is seen, as in a depth image, the likeliest first.

    None of fewer than 100 points. Those that the steepest normals are not steep to, and from which hardly a point is
    behind others. Of a direction and its opposite it is the one from which the surface slopes down where it ends.

    Parameters
    ----------
    points, normals : ndarray, shape (l, 3)
        Unit normals; their signs do not matter.
    spacing : float
        Distance of the points.
    """
    if len(points) < TUNED.least_points:
        return np.empty((0, 3))
    numbers = np.arange(TUNED.num_directions) + 0.5
    heights = 1.0 - numbers / TUNED.num_directions
    angles, radii = np.pi * (1.0 + np.sqrt(5.0)) * numbers, np.sqrt(1.0 - heights**2)
    directions = np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=1)
    cosines = np.quantile(np.abs(normals @ directions.T), 0.03, axis=0)
    possible = np.flatnonzero(cosines >= TUNED.steepest)
    if not len(possible):
        return np.empty((0, 3))
    directions = directions[possible]
    hidden = np.array(
        [_share_hidden(points, normals, direction, spacing) for direction in directions]
    )
    scores = cosines[possible] - TUNED.hidden_weight * hidden
    best = int(np.argmax(scores))
    if hidden[best] > TUNED.most_hidden:
        return np.empty((0, 3))
    near = directions[scores >= scores[best] - TUNED.slack]
    sights = directions[[best]]
    while (cosines := np.abs(near @ sights.T).max(axis=1)).min() <= TUNED.apart:
        sights = np.concatenate([sights, near[[int(cosines.argmin())]]])
    arms = points - points[
        cKDTree(points).query(points, k=min(TUNED.num_around, len(points)))[1]
    ].mean(axis=1)
    slopes = normals * np.sign(normals @ sights[0])[:, None]
    falling = np.vdot(slopes, arms) - (slopes @ sights[0]) @ (arms @ sights[0])
    return (
        sights
        * np.where(sights @ sights[0] < 0.0, -1.0, 1.0)[:, None]
        * (1.0 if falling >= 0 else -1.0)
    )


def _share_hidden(
    points: FloatArray, normals: FloatArray, sight: FloatArray, spacing: float
) -> float:
    """Return the share of points farther behind the foremost one of a pixel than their slope explains."""
    along = points @ np.linalg.svd(sight[None])[2].T
    pixels = np.floor((along[:, 1:] - along[:, 1:].min(axis=0)) / spacing).astype(np.int64)
    keys = pixels[:, 0] * (pixels[:, 1].max() + 1) + pixels[:, 1]
    depth = points @ sight
    front = np.full(keys.max() + 1, -np.inf)
    np.maximum.at(front, keys, depth)
    return float(
        (front[keys] - depth > 2.0 * spacing / np.maximum(np.abs(normals @ sight), 0.1)).mean()
    )
