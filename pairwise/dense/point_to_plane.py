"""Point-to-plane ICP by Open3D (an extra: ``pip install 'collalign[open3d]'``)."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.errors import InputError, OptionsError
from data_tools.poses import Similarity
from data_tools.rotations import nearest_orthogonal
from pairwise.dense.points import DensePoints


def point_to_plane(
    target: DensePoints,
    source: DensePoints,
    start: Similarity,
    *,
    max_distance: float = np.inf,
    max_iterations: int = 30,
    tol: float = 1e-6,
) -> tuple[Similarity, bool]:
    """Refine a pose by point-to-plane ICP (Chen and Medioni 1992) of nearest neighbours of the source's points.

    Parameters
    ----------
    target : DensePoints
        With normals, in three dimensions.
    source : DensePoints
    start : Similarity
        Its scale and chirality stay.
    max_distance : float
        Points without a neighbour within this distance take no part.
    max_iterations : int
    tol : float
        Stops when fitness and error change by less, relatively.

    Returns
    -------
    pose : Similarity
    found : bool
        Whether Open3D found correspondences; the pose is the start if not.

    Raises
    ------
    InputError
        If the target has no normals, or the points are not in three dimensions.
    OptionsError
        If Open3D is not installed.
    """
    if target.normals is None:
        raise InputError("target: point-to-plane needs normals; this shape has none")
    if target.points.shape[1] != 3:
        raise InputError(f"target: point-to-plane needs three dimensions, got {target.points.shape[1]}")
    open3d = _open3d()
    registration = open3d.pipelines.registration
    # Open3D moves rigidly: the source is scaled, turned and mirrored first, and only the rest is left to it.
    cloud = _cloud(open3d, start.apply(source.points))
    goal = _cloud(open3d, target.points)
    goal.normals = open3d.utility.Vector3dVector(np.array(target.normals))
    reach = max_distance if np.isfinite(max_distance) else 10.0 * (target.radius + start.scale * source.radius)
    found = registration.registration_icp(
        cloud,
        goal,
        float(reach),
        np.eye(4),
        registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(tol, tol, max_iterations),
    )
    move = np.asarray(found.transformation, dtype=np.float64)
    if not len(found.correspondence_set) or not np.isfinite(move).all():
        return start, False
    turn = nearest_orthogonal(move[:3, :3])
    pose = Similarity(rotation=turn @ start.rotation, scale=start.scale, shift=turn @ start.shift + move[:3, 3])
    return pose, True


def _open3d() -> Any:
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise OptionsError(
            f"point-to-plane refinement is Open3D's, which cannot be imported ({error}); "
            "install it with: pip install 'collalign[open3d]'"
        ) from error
    return open3d


def _cloud(open3d: Any, points: FloatArray) -> Any:
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.array(points)))
