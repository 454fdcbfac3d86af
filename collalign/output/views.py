"""What a collection looks like: meshes of few triangles, seen from between front, side and top."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from collalign.products.named_frame import NamedFrame
from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.cleaning import decimate

#: A picture shows the front rotated to the left by the first and from above by the second, which shows three sides.
_AZIMUTH_RAD, _ABOVE_RAD = np.deg2rad([30.0, 20.0])
#: No direction has a name.
UNNAMED = NamedFrame()


def camera(surfaces: Iterable[tuple[FloatArray, IntArray]], frame: NamedFrame = UNNAMED) -> FloatArray:
    """Return the rotation from the common frame to the screen in three-quarter view.

    Parameters
    ----------
    surfaces : iterable of (vertices, faces)
        In the common frame, shapes (v, 3) and (f, 3); no faces for a point cloud.
    frame : NamedFrame
        Up and front. Without them they are those of :func:`principal_view`; where only up has a name, the front is
        the level direction in which the surfaces are thinnest.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows are the directions to the right, upwards and to the viewer.
    """
    up, front = frame.directions
    if up is None:
        view = principal_view(surfaces)
    else:
        if front is None:
            level = np.eye(3) - np.outer(up, up)
            second, third = _moments(surfaces)
            third = np.einsum("ijk,ia,jb,kc->abc", third, level, level, level, optimize=True)
            front = _principal(level @ second @ level, third)[1]
        view = np.stack([np.cross(up, front), up, front])
    (c, s), (a, b) = ((np.cos(angle), np.sin(angle)) for angle in (_AZIMUTH_RAD, _ABOVE_RAD))
    rotation = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    above = np.array([[1.0, 0.0, 0.0], [0.0, a, -b], [0.0, b, a]])
    return np.asarray(above @ rotation @ view)


def principal_view(surfaces: Iterable[tuple[FloatArray, IntArray]]) -> FloatArray:
    """Return the rotation that shows the longest axis level and the shortest to the viewer, shape (3, 3).

    The axes are the principal ones of all surfaces, each centred and brought to one size, so they rotate with the
    collection. Of the three directions the two in which mass lies least evenly (by skewness) have the thin end in
    front, handedness decides the third.
    """
    return _principal(*_moments(surfaces))


def _moments(surfaces: Iterable[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, FloatArray]:
    """Return the second and third moments of all surfaces, shapes (3, 3) and (3, 3, 3)."""
    second, third = np.zeros((3, 3)), np.zeros((3, 3, 3))
    for vertices, faces in surfaces:
        points, weights = _spread(vertices, faces)
        second += np.einsum("n,ni,nj->ij", weights, points, points)
        third += np.einsum("n,ni,nj,nk->ijk", weights, points, points, points, optimize=True)
    return second, third


def _principal(second: FloatArray, third: FloatArray) -> FloatArray:
    variances, vectors = np.linalg.eigh(second)
    axes = vectors[:, ::-1].T
    skewness = np.einsum("ijk,ai,aj,ak->a", third, axes, axes, axes, optimize=True)
    skewness /= np.maximum(variances[::-1], np.finfo(float).eps * max(variances[-1], 1.0)) ** 1.5
    axes *= np.where(skewness < 0, -1.0, 1.0)[:, None]
    if np.linalg.det(axes) < 0:
        axes[np.abs(skewness).argmin()] *= -1.0
    return np.asarray(axes)


def _spread(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return points of a surface about its centroid, root mean square radius one, and their shares of its area."""
    points, weights = vertices, np.ones(len(vertices))
    if len(faces):
        corners = vertices[faces]
        points = corners.mean(axis=1)
        weights = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    weights = weights / (weights.sum() or 1.0)
    points = points - weights @ points
    return points / (np.sqrt(weights @ (points**2).sum(axis=1)) or 1.0), weights


#: A report holds about this many triangles in all, but each shape between the two limits.
_FACES_IN_ALL = 200_000
FEWEST_FACES, _MOST = 1_500, 4_000
#: No collection holds more triangles than this: of many thousand shapes each has fewer than :data:`FEWEST_FACES`.
_MOST_IN_ALL = 4_000_000


def faces_per_shape(num_shapes: int) -> int:
    """Return triangles per shape that keep a report of ``num_shapes`` shapes small enough to send."""
    num = max(num_shapes, 1)
    return min(int(np.clip(_FACES_IN_ALL // num, FEWEST_FACES, _MOST)), max(_MOST_IN_ALL // num, 1))


def display_mesh(vertices: FloatArray, faces: IntArray, *, max_faces: int) -> tuple[FloatArray, IntArray]:
    """Decimate a mesh by edge collapses, or thin out a point cloud evenly.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Empty for a point cloud.
    max_faces : int
        Triangles (points for a cloud) to keep, about.

    Returns
    -------
    vertices : ndarray, shape (w, 3)
    faces : ndarray of int, shape (g, 3)
    """
    if not len(faces):
        stride = -(-len(vertices) // max_faces)
        return np.ascontiguousarray(vertices[::stride]), np.empty((0, 3), dtype=np.int64)
    return decimate(vertices, faces, max_faces)
