"""Rotations: random ones, angles between them, the nearest to a matrix, and the one that landmarks ask for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, as_floats
from data_tools.checks import check_choice
from data_tools.errors import InputError


def random_rotation(rng: np.random.Generator, dim: int = 3, *, group: str = "SO") -> FloatArray:
    """Draw a matrix uniformly from the rotations, or from all orthogonal matrices, shape (dim, dim).

    QR of a Gaussian matrix with the signs of R's diagonal removed (Stewart 1980).

    Raises
    ------
    OptionsError
        If the group is neither "SO" nor "O".
    """
    check_choice("group", group, ("SO", "O"))
    q, r = np.linalg.qr(rng.standard_normal((dim, dim)))
    q = q * np.sign(np.diag(r))
    if group == "SO" and np.linalg.det(q) < 0:
        q[:, 0] = -q[:, 0]
    return np.ascontiguousarray(q)


def rotation_angle_deg(a: ArrayLike, b: ArrayLike | None = None) -> FloatArray:
    """Return the angle of the rotation between a and b (of a itself without b) in degrees, shape (...).

    Between a rotation and a reflection there is none: NaN.

    Parameters
    ----------
    a, b : array_like, shape (..., 3, 3)
        Orthogonal.

    Notes
    -----
    The formula is that of :func:`chordal_angles`.
    """
    first = as_floats(a, "a")
    second = np.eye(3) if b is None else as_floats(b, "b")
    if first.shape[-2:] != (3, 3) or second.shape[-2:] != (3, 3):
        raise InputError(f"expected 3 x 3 matrices, got shapes {first.shape} and {second.shape}")
    same_handed = np.linalg.det(first) * np.linalg.det(second) > 0
    return np.where(same_handed, np.degrees(chordal_angles(first, second)), np.nan)


def rotation_angles(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the angle between orthogonal matrices in radians, shape broadcast from (..., d, d).

    Of matrices of equal determinant: the Riemannian distance for d = 2 and 3; above, the angle of that single plane
    rotation whose chordal distance is the same (pi where there is none). For opposite determinants it is pi.
    """
    opposite = np.linalg.det(first) * np.linalg.det(second) < 0
    return np.where(opposite, np.pi, chordal_angles(first, second))


def chordal_angles(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the angle in radians of the plane rotation as far from the identity as first is from second, in |.|_F.

    Of matrices (..., 3, 3); the angles have shape (...).
    |first - second|_F^2 = 8 sin^2(angle / 2), which keeps full precision at small angles; pi where it is more than 8.
    """
    distance = np.sqrt(((first - second) ** 2).sum(axis=(-1, -2)))
    return np.asarray(2.0 * np.arcsin(np.clip(distance / np.sqrt(8.0), 0.0, 1.0)))


def nearest_orthogonal(matrices: FloatArray, *, determinant: float | None = None) -> FloatArray:
    """Return the orthogonal matrices nearest to the given ones in the Frobenius norm, shape (..., d, d).

    Parameters
    ----------
    matrices : ndarray, shape (..., d, d)
        For orthogonal Procrustes (Schoenemann 1966) pass ``target.T @ source``.
    determinant : {1, -1}, optional
        Ask for this determinant (Kabsch 1976): the weakest direction is turned round where it is the other one.
    """
    u, _, vt = np.linalg.svd(matrices)
    if determinant is not None:
        u[..., -1] *= (np.sign(np.linalg.det(u @ vt)) * determinant)[..., None]
    return np.asarray(u @ vt)


def spread_directions(num: int) -> FloatArray:
    """Return almost evenly spread points of the unit sphere, from its highest to its lowest, shape (num, 3).

    References
    ----------
    Gonzalez, Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices, Mathematical
    Geosciences 42 (2010).
    """
    index = np.arange(num)
    z = 1.0 - (2.0 * index + 1.0) / num
    angle = np.pi * (3.0 - np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def half_sphere(num: int) -> FloatArray:
    """Return evenly spread unit directions, shape (num, 3)."""
    numbers = np.arange(num) + 0.5
    heights = 1.0 - numbers / num
    angles, radii = np.pi * (1.0 + np.sqrt(5.0)) * numbers, np.sqrt(1.0 - heights**2)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=1)
