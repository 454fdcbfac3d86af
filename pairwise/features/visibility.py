"""What one direction saw contradicts whatever lies in front of it: the free space of depth images.

A depth image says more than where a surface is. Between the surface and what saw it, there is nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from data_tools.arrays import FloatArray
from data_tools.local_surface import LocalSurface

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
    def along(cls, surface: LocalSurface, sight: FloatArray) -> DepthImage:
        """Return the depth image of a surface along a line of sight, a unit direction (3,) towards what saw it."""
        axes = np.concatenate([np.linalg.svd(sight[None])[2][1:], sight[None]])
        along = surface.points @ axes.T
        corner = along[:, :2].min(axis=0) - surface.cell
        pixels = np.floor((along[:, :2] - corner) / surface.cell).astype(np.int64)
        heights = np.full(pixels.max(axis=0) + 2, -np.inf)
        np.maximum.at(heights, tuple(pixels.T), along[:, 2])
        heights = maximum_filter(heights, size=3, mode="constant", cval=-np.inf)
        heights[np.isneginf(heights)] = np.inf
        return cls(axes=axes, corner=corner, heights=heights, cell=surface.cell)

    def share_in_front(self, points: FloatArray) -> FloatArray:
        """Return the share of points (p, n, 3) that would have been seen instead of what was, shape (p,)."""
        along = points @ self.axes.T
        pixels = np.floor((along[..., :2] - self.corner) / self.cell).astype(np.int64)
        inside = ((pixels >= 0) & (pixels < self.heights.shape)).all(axis=-1)
        pixels[~inside] = 0
        seen = self.heights[pixels[..., 0], pixels[..., 1]]
        return np.asarray((inside & (along[..., 2] > seen + FRONT_CELLS * self.cell)).mean(axis=1))


def shares_in_front(
    target: LocalSurface, source: LocalSurface, rotations: FloatArray, shifts: FloatArray
) -> FloatArray:
    """Return the share of either surface's points that lie in front of what was seen of the other, shape (p, 2).

    The target's come first; the least share of all possible lines of sight. NaN where no single direction saw all of
    the other surface.

    Parameters
    ----------
    target, source : LocalSurface
    rotations : ndarray, shape (p, 3, 3)
        Of determinant 1.
    shifts : ndarray, shape (p, 3)
        Source coordinates to those of the target, with the rotations.
    """
    shares = np.full((len(rotations), 2), np.nan)
    turned = np.swapaxes(rotations, 1, 2)
    for side, seen, points in (
        (0, source, (target.points[target.compared] - shifts[:, None]) @ rotations),
        (1, target, source.points[source.compared] @ turned + shifts[:, None]),
    ):
        if len(seen.sights):
            each = [DepthImage.along(seen, sight).share_in_front(points) for sight in seen.sights]
            shares[:, side] = np.min(each, axis=0)
    return shares
