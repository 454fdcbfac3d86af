"""From where a collection is looked at: along the shortest axis of what it has in common, the longest one level."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from data_tools.arrays import FloatArray, IntArray


def camera(surfaces: Iterable[tuple[FloatArray, IntArray]]) -> FloatArray:
    """Return the rotation from the common frame to the screen; it turns with the collection.

    The axes are the principal ones of all surfaces, each centred and brought to one size. Of the three directions
    the two in which mass lies least evenly (by skewness) have the thin end in front, handedness decides the third.

    Parameters
    ----------
    surfaces : iterable of (vertices, faces)
        In the common frame, shapes (v, 3) and (f, 3); no faces for a point cloud.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows are the directions to the right, upwards and to the viewer.
    """
    second, third = np.zeros((3, 3)), np.zeros((3, 3, 3))
    for vertices, faces in surfaces:
        points, weights = _spread(vertices, faces)
        second += np.einsum("n,ni,nj->ij", weights, points, points)
        third += np.einsum("n,ni,nj,nk->ijk", weights, points, points, points, optimize=True)
    variances, vectors = np.linalg.eigh(second)
    axes = vectors[:, ::-1].T
    skewness = np.einsum("ijk,ai,aj,ak->a", third, axes, axes, axes, optimize=True)
    skewness /= np.maximum(variances[::-1], np.finfo(float).tiny) ** 1.5
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
