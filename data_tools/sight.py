"""Surfaces that one direction saw, such as depth images: from where, and what that tells of the space before them.

A depth image says more than where a surface is. Between the surface and what saw it, there is nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from data_tools.arrays import BoolArray, FloatArray
from data_tools.rotations import half_sphere


class SightTuning(NamedTuple):
    """Numbers by which a line of sight is found.

    Chosen between views of four models, with scans of a bunny, and whole clouds of six classes.
    """

    least_points: int = 100
    """Fewer points tell nothing: their normals and what hides them are noise."""
    most_points: int = 4000
    """Of more points an even choice, ..."""
    most_normals: int = 1000
    """... and of their normals one of so many."""
    num_directions: int = 2000
    """Directions of a half sphere that are tried, ..."""
    num_likely: int = 100
    """... and those of them from which it is looked what is hidden."""
    num_around: int = 16
    """Points around one that say how dense they are, and whether the surface ends there, and to which side."""
    flat: float = 0.03
    """The density is that of a surface where neighbours vary across it by less than this share of along it, ..."""
    middle: float = 0.4
    """... and where their mean is no farther off than this share of the farthest one."""
    steepest: float = 0.15
    """A surface was seen from one direction if at most 3 % of its normals are steeper than this cosine, ..."""
    most_hidden: float = 0.1
    """... and at most this share of its points lie behind others."""
    slack: float = 0.02
    """Directions that are no worse than the best one by this are possible, too, ..."""
    apart: float = 0.98
    """... those that differ by this cosine."""
    front_cells: float = 1.5
    """A point is in front of what was seen if it is so many cells nearer than all that was seen around, ..."""
    least_faced: float = 0.3
    """Normals that are steeper than this cosine belong to a surface that is seen from its edge, ..."""
    beside_pixels: int = 2
    """... and beside it if nothing was seen in so many pixels around."""


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
    is_beside : ndarray of bool, shape (h, w)
        Pixels around which nothing was seen.
    cell : float
        Side of a pixel.
    """

    axes: FloatArray
    corner: FloatArray
    heights: FloatArray
    is_beside: BoolArray
    cell: float

    @classmethod
    def along(cls, sight: FloatArray, points: FloatArray, cell: float) -> DepthImage:
        """Return the depth image of points (l, 3) along a unit direction (3,) towards what saw them."""
        axes = np.concatenate([np.linalg.svd(sight[None])[2][1:], sight[None]])
        along = points @ axes.T
        corner = along[:, :2].min(axis=0) - TUNED.beside_pixels * cell
        pixels = np.floor((along[:, :2] - corner) / cell).astype(np.int64)
        heights = np.full(pixels.max(axis=0) + 1 + TUNED.beside_pixels, -np.inf)
        np.maximum.at(heights, tuple(pixels.T), along[:, 2])
        around = 2 * TUNED.beside_pixels + 1
        is_beside = np.isneginf(maximum_filter(heights, size=around, mode="constant", cval=-np.inf))
        heights = maximum_filter(heights, size=3, mode="constant", cval=-np.inf)
        heights[np.isneginf(heights)] = np.inf
        return cls(axes=axes, corner=corner, heights=heights, is_beside=is_beside, cell=cell)

    def conflicts(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the shares of points (p, n, 3) that are in front of what was seen and beside it, shape (p, 2).

        Points of a surface that was seen from its edge, by their normals (p, n, 3) of either sign, are not in front:
        a thin board is missed between two pixels.
        """
        is_faced = np.abs(normals @ self.axes[2]) >= TUNED.least_faced
        x, y, depth = (points @ axis for axis in self.axes)
        row, column = (
            np.floor((at - first) / self.cell)
            for at, first in zip((x, y), self.corner, strict=True)
        )
        height, width = self.heights.shape
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        pixels = np.where(inside, row * width + column, 0).astype(np.int64)
        seen = self.heights.take(pixels)
        in_front = inside & is_faced & (depth > seen + TUNED.front_cells * self.cell)
        beside = ~inside | self.is_beside.take(pixels)
        return np.stack([in_front.mean(axis=1), beside.mean(axis=1)], axis=1)


def lines_of_sight(points: FloatArray) -> FloatArray:
    """Return unit directions (s, 3) from which all of a cloud is seen, as in a depth image, the likeliest first.

    None of fewer than 100 points. Those that the steepest normals are not steep to, and from which hardly a point is
    behind others. Among them those that explain best how dense the points are: what looks at a surface at an angle
    sees it with fewer points, by the cosine of that angle. Of a direction and its opposite it is the one from which
    the surface slopes down where it ends.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        As they were seen: not thinned to equal distances.
    """
    if len(points) < TUNED.least_points:
        return np.empty((0, 3))
    points = points[:: -(-len(points) // TUNED.most_points)]
    distances, near = cKDTree(points).query(points, k=min(TUNED.num_around + 1, len(points)))
    reach = np.maximum(distances[:, -1], np.finfo(float).tiny)
    spread = points[near] - points[near].mean(axis=1, keepdims=True)
    variances, axes = np.linalg.eigh(np.swapaxes(spread, 1, 2) @ spread)
    normals, arms = axes[:, :, 0], spread[:, 0]
    few = slice(None, None, -(-len(points) // TUNED.most_normals))
    directions = half_sphere(TUNED.num_directions)
    cosines = np.abs(normals[few] @ directions.T)
    num_steep = np.count_nonzero(cosines < TUNED.steepest, axis=0)
    likely = np.flatnonzero(num_steep <= int(0.03 * len(cosines)))
    if not len(likely):
        return np.empty((0, 3))
    is_inner = variances[few, 0] < TUNED.flat * variances[few, 1]
    is_inner &= np.linalg.norm(arms[few], axis=1) < TUNED.middle * reach[few]
    inner = np.flatnonzero(is_inner)
    residuals = np.zeros(len(likely))
    if len(inner):
        areas = np.log(np.maximum(cosines[np.ix_(inner, likely)], 0.1))
        areas += 2.0 * np.log(reach[few][inner])[:, None]
        residuals = np.abs(areas - np.median(areas, axis=0)).mean(axis=0)
    order = np.argsort(residuals, kind="stable")[: TUNED.num_likely]
    likely, residuals = likely[order], residuals[order]
    spacing = float(np.median(reach)) * np.sqrt(np.pi / TUNED.num_around)
    hidden = np.array([_share_hidden(points, normals, directions[one], spacing) for one in likely])
    costs = residuals + hidden
    best = int(np.argmin(costs))
    if hidden[best] > TUNED.most_hidden:
        return np.empty((0, 3))
    possible = directions[likely[costs <= costs[best] + TUNED.slack]]
    sights = directions[likely[[best]]]
    while (cosines := np.abs(possible @ sights.T).max(axis=1)).min() <= TUNED.apart:
        sights = np.concatenate([sights, possible[[int(cosines.argmin())]]])
    slopes = normals * np.sign(normals @ sights[0])[:, None]
    falling = np.vdot(slopes, arms) - (slopes @ sights[0]) @ (arms @ sights[0])
    sights = sights * np.where(sights @ sights[0] < 0.0, -1.0, 1.0)[:, None]
    return sights if falling >= 0 else -sights


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
