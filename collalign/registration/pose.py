"""The similarity that lays one surface onto another best, before anything bends."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.rotations import nearest_orthogonal


def fitting_similarity(to: FloatArray, of: FloatArray, weights: FloatArray, *, turns: bool = True) -> FloatArray:
    """Return the similarity that brings points to their counterparts best, shape (4, 4), never a mirror image.

    Parameters
    ----------
    to, of : ndarray, shape (p, 3)
    weights : ndarray, shape (p,)
        Not negative, and not all zero.
    turns : bool
        Whether it may rotate, beside shifting and scaling.

    References
    ----------
    Umeyama 1991. The scale is the symmetric one, the ratio of both sizes: least squares would shrink the source the
    more, the worse points correspond.
    """
    shares = weights / weights.sum()
    mean_to, mean_of = shares @ to, shares @ of
    centred_to, centred_of = to - mean_to, of - mean_of
    products = centred_to.T @ (shares[:, None] * centred_of)
    rotation = nearest_orthogonal(products, determinant=1.0) if turns else np.eye(3)
    sizes = [float(shares @ (points**2).sum(axis=1)) for points in (centred_to, centred_of)]
    scale = float(np.sqrt(sizes[0] / sizes[1])) if min(sizes) > 0 else 1.0
    pose = np.eye(4)
    pose[:3, :3] = scale * rotation
    pose[:3, 3] = mean_to - pose[:3, :3] @ mean_of
    return pose
