"""A surface as well-spread points with normals, and which of them lie at a rim: what matching in part works on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import BoolArray, FloatArray, Holds, read_only
from data_tools.embedding.sampling import farthest_points
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.options import SamplingOptions
from data_tools.surface.normals import outward_normals
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges

#: Larger meshes are decimated to so many triangles: their vertices are what is matched.
MAX_FACES = 40_000
#: Meshes with a larger share of edges on whose side their triangles disagree have normals of unknown sign.
MAX_DEFECTS = 0.01
#: Neighbours that a plane is fitted to where there are no triangles.
NUM_NEIGHBOURS = 30
#: A point of a cloud lies on a rim if so many neighbours leave a gap of more than this angle around it, in radians.
RIM_NEIGHBOURS, RIM_GAP = 12, 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientedPoints:
    """Points of a surface, in the order of farthest point sampling.

    Attributes
    ----------
    points : ndarray, shape (l, 3)
    normals : ndarray, shape (l, 3)
    on_rim : ndarray of bool, shape (l,)
        No farther from the mesh's boundary than points lie apart; of a point cloud, those whose neighbours leave a
        wide gap around them.
    oriented : bool
        Whether all normals point outwards; else their signs mean nothing.
    """

    points: Annotated[FloatArray, Holds(shape="l 3")]
    normals: Annotated[FloatArray, Holds(shape="l 3")]
    on_rim: Annotated[BoolArray, Holds(shape="l")]
    oriented: bool


def spread_points(shape: Shape, num: int) -> OrientedPoints:
    """Return at most ``num`` Euclidean farthest points of a mesh or point cloud, in its own coordinates."""
    small = WorkingSurface(shape, SamplingOptions(max_faces=MAX_FACES)).shape
    chosen = farthest_points(
        small, min(num, len(np.unique(small.vertices, axis=0))), metric="euclidean"
    )
    points = small.vertices[chosen]
    normals = outward_normals(small, max_defects=MAX_DEFECTS)
    oriented = len(normals) > 0
    directions = normals[chosen] if oriented else plane_normals(small.vertices, points)
    on_rim = _mesh_rim(small, points) if small.is_mesh else cloud_rim(points, directions)
    return OrientedPoints(
        points=read_only(points),
        normals=read_only(directions),
        on_rim=read_only(on_rim),
        oriented=oriented,
    )


def _mesh_rim(mesh: Shape, points: FloatArray) -> BoolArray:
    """Return which points are near the mesh's boundary."""
    rim = np.unique(boundary_edges(mesh.faces))
    if not len(rim):
        return np.zeros(len(points), dtype=np.bool_)
    spacing = np.median(cKDTree(points).query(points, k=2)[0][:, 1])
    return np.asarray(cKDTree(mesh.vertices[rim]).query(points)[0] < spacing)


def cloud_rim(points: FloatArray, normals: FloatArray) -> BoolArray:
    """Return which points (n, 3) of a cloud lie on a rim: their neighbours, along the normal, leave a wide gap."""
    num = min(RIM_NEIGHBOURS + 1, len(points))
    arms = points[cKDTree(points).query(points, k=num)[1][:, 1:]] - points[:, None]
    across = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(normals, across)
    angles = np.arctan2(np.einsum("lka,la->lk", arms, other), np.einsum("lka,la->lk", arms, across))
    angles = np.sort(angles, axis=1)
    gaps = np.diff(angles, axis=1, append=angles[:, :1] + 2.0 * np.pi)
    return np.asarray(gaps.max(axis=1) > RIM_GAP)


def plane_normals(cloud: FloatArray, places: FloatArray) -> FloatArray:
    """Return unit normals (q, 3), of either sign, of the planes through a cloud around each place (q, 3)."""
    near = cloud[cKDTree(cloud).query(places, k=min(NUM_NEIGHBOURS, len(cloud)))[1]]
    moments = near - near.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.swapaxes(moments, 1, 2) @ moments)[1][:, :, 0])
