"""A surface as well-spread points with normals, and which of them lie at a rim: what matching in part works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import BoolArray, FloatArray, read_only
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.options import SamplingOptions
from data_tools.surface.normals import outward_normals
from data_tools.surface.shape import Shape
from data_tools.surface.topology import mesh_edges

#: Meshes with a larger share of edges on whose side their triangles disagree have normals of unknown sign.
MAX_DEFECTS = 0.01
#: Neighbours that a plane is fitted to where there are no triangles.
NUM_NEIGHBOURS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Points of a surface, in the order of farthest point sampling.

    Attributes
    ----------
    points : ndarray, shape (l, 3)
    normals : ndarray, shape (l, 3)
    on_rim : ndarray of bool, shape (l,)
        No farther from the mesh's boundary than points lie apart; false throughout for point clouds.
    oriented : bool
        Whether all normals point outwards; else their signs mean nothing.
    """

    points: FloatArray
    normals: FloatArray
    on_rim: BoolArray
    oriented: bool


def surface_points(shape: Shape, num: int) -> SurfacePoints:
    """Return at most ``num`` Euclidean farthest points of a mesh or point cloud, in its own coordinates."""
    small = WorkingSurface(shape, SamplingOptions()).shape
    chosen = farthest_points(small, min(num, len(np.unique(small.vertices, axis=0))), metric="euclidean")
    points = small.vertices[chosen]
    normals = outward_normals(small, max_defects=MAX_DEFECTS)
    oriented = len(normals) > 0
    rim = np.unique(mesh_edges(small.faces).boundary) if small.is_mesh else np.empty(0, dtype=np.int64)
    on_rim = np.zeros(len(points), dtype=np.bool_)
    if len(rim):
        spacing = np.median(cKDTree(points).query(points, k=2)[0][:, 1])
        on_rim = cKDTree(small.vertices[rim]).query(points)[0] < spacing
    return SurfacePoints(
        points=read_only(points),
        normals=read_only(normals[chosen] if oriented else plane_normals(small.vertices, points)),
        on_rim=read_only(on_rim),
        oriented=oriented,
    )


def plane_normals(cloud: FloatArray, places: FloatArray) -> FloatArray:
    """Return unit normals, of either sign, of the planes through the points of a cloud around each place."""
    near = cloud[cKDTree(cloud).query(places, k=min(NUM_NEIGHBOURS, len(cloud)))[1]]
    moments = near - near.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.swapaxes(moments, 1, 2) @ moments)[1][:, :, 0])
