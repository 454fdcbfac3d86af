"""Evenly spread points of every shape of a result, at its pose."""

from __future__ import annotations

from collalign.output.collection import Collection
from collalign.tools.classify.surface_distance import unit_cloud
from data_tools.arrays import FloatArray
from data_tools.embedding.sampling import farthest_points
from data_tools.surface.shape import Shape

#: Points of each shape. Even points make closest points a measure of the surfaces alone.
NUM_POINTS = 400


def posed_clouds(collection: Collection) -> list[FloatArray]:
    """Return farthest points of every display mesh, centred and of unit size in the common frame, each (k, 3)."""
    clouds = []
    for vertices, rotation in zip(collection.vertices, collection.rotations, strict=True):
        shape = Shape.from_arrays(vertices)
        chosen = farthest_points(shape, min(NUM_POINTS, len(vertices)), metric="euclidean")
        clouds.append(unit_cloud(vertices[chosen]) @ rotation.T)
    return clouds
