"""Thin-plate splines in space: carry a surface along with its landmarks, to draw a mean or a principal component."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, as_points
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread


@one_blas_thread()
def thin_plate_warp(
    vertices: ArrayLike, source: ArrayLike, target: ArrayLike, *, smoothing: float = 0.0
) -> FloatArray:
    """Move vertices by the thin-plate spline that takes source landmarks to target landmarks.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
    source, target : array_like, shape (k, 3)
        At least five landmarks, not all in one plane.
    smoothing : float
        0 interpolates; larger values follow noisy landmarks less closely.

    Returns
    -------
    ndarray, shape (v, 3)

    Raises
    ------
    InputError
        If the landmarks do not determine a spline.

    References
    ----------
    Bookstein, Principal warps: thin-plate splines and the decomposition of deformations, IEEE PAMI 11 (1989); in
    three dimensions the kernel is the distance itself.
    """
    points = as_points(vertices, "vertices", dim=3)
    landmarks = as_points(source, "source", min_points=5, dim=3)
    goals = as_points(target, "target", dim=3)
    if goals.shape != landmarks.shape:
        raise InputError(f"target: {len(goals)} landmarks for {len(landmarks)} of the source")
    from scipy.interpolate import RBFInterpolator  # a tenth of a second that most commands do without

    try:
        spline = RBFInterpolator(landmarks, goals - landmarks, kernel="linear", degree=1, smoothing=smoothing)
    except np.linalg.LinAlgError as error:
        raise InputError("source: landmarks coincide or lie in one plane, so no spline is determined") from error
    return points + spline(points)
