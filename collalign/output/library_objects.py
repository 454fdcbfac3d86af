"""Shapes as objects of other libraries: trimesh and Open3D."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_tools.errors import UnavailableError
from data_tools.surface.shape import Shape

#: What installs the libraries of the system that Open3D loads.
_SYSTEM = "apt-get install libusb-1.0-0 libegl1 libgl1 libx11-6 libgomp1"


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
    except (ImportError, OSError) as error:
        raise UnavailableError(
            f"to_open3d needs Open3D, which cannot be imported ({error}); install it with: pip install "
            f"'collalign[open3d]'. If a library of the system is missing, on Debian also: {_SYSTEM}"
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
