"""Shapes as objects of other libraries: trimesh and Open3D."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_tools.errors import UnavailableError
from data_tools.surface.shape import Shape


def trimesh_of(shape: Shape) -> Any:
    """Return a shape as ``trimesh.Trimesh``, or ``trimesh.PointCloud`` where it has no faces."""
    import trimesh

    if not shape.is_mesh:
        return trimesh.PointCloud(shape.vertices.copy())
    return trimesh.Trimesh(shape.vertices.copy(), shape.faces.copy(), process=False)


def open3d_of(shape: Shape) -> Any:
    """Return a shape as ``open3d.geometry.TriangleMesh``, or ``PointCloud`` where it has no faces.

    Raises
    ------
    UnavailableError
        If Open3D cannot be imported.
    """
    try:
        import open3d
    except (
        ImportError,
        OSError,
    ) as error:  # it is missing, or a library of the system that it loads
        raise UnavailableError(
            f"to_open3d needs Open3D, which cannot be imported ({error}); install it with: pip install "
            "'collalign[open3d]'. If a system library is missing, install that too (docs/python.md lists them)"
        ) from None
    vertices = open3d.utility.Vector3dVector(shape.vertices.copy())  # it takes no read-only array
    if not shape.is_mesh:
        cloud = open3d.geometry.PointCloud()
        cloud.points = vertices
        return cloud
    mesh = open3d.geometry.TriangleMesh()
    mesh.vertices = vertices
    mesh.triangles = open3d.utility.Vector3iVector(shape.faces.astype(np.int32))
    return mesh
