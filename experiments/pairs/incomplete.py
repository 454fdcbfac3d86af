"""Shapes of which a part is cut off."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.surface.shape import Shape


def without_share(shape: Shape, direction: FloatArray, share: float) -> Shape:
    """Return the shape without the share of its vertices that lies farthest in a direction."""
    heights = shape.vertices @ direction
    kept = heights <= np.quantile(heights, 1.0 - share)
    number = np.cumsum(kept) - 1
    faces = number[shape.faces[kept[shape.faces].all(axis=1)]]
    used = np.unique(faces)
    rank = np.full(kept.sum(), -1)
    rank[used] = np.arange(len(used))
    return Shape.from_arrays(shape.vertices[kept][used], rank[faces], name=shape.name)
