"""Rotations to start from: low-discrepancy sets, principal axes, and uniform draws in high dimension."""

from __future__ import annotations

from itertools import product

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.errors import OptionsError

#: The irrational pair of Alexa (2022): the square root of 2 and the positive root of psi^4 = psi + 4.
_PHI, _PSI = np.sqrt(2.0), 1.533751168755204288118041


def rotation_set(dim: int, num: int, *, seed: int = 0) -> FloatArray:
    """Return rotations that cover SO(d) evenly.

    Parameters
    ----------
    dim : int
        d. Equal angles for 2, the super-Fibonacci spiral for 3 (Alexa, "Super-Fibonacci spirals: fast,
        low-discrepancy sampling of SO(3)", CVPR 2022), uniform random rotations above.
    num : int
        How many.
    seed : int
        Used for d > 3 only.

    Returns
    -------
    ndarray, shape (num, d, d)

    Raises
    ------
    OptionsError
        If ``num`` is not positive.
    """
    if num < 1:
        raise OptionsError(f"number of rotations: expected at least 1, got {num}")
    if dim == 2:
        angles = 2.0 * np.pi * np.arange(num) / num
        cos, sin = np.cos(angles), np.sin(angles)
        return np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    if dim == 3:
        return quaternions_to_rotations(super_fibonacci(num))
    return random_rotations(dim, num, np.random.default_rng(seed))


def super_fibonacci(num: int) -> FloatArray:
    """Return the super-Fibonacci spiral on the unit quaternions (Alexa 2022, algorithm 1), shape (num, 4)."""
    s = np.arange(num) + 0.5
    r, big_r = np.sqrt(s / num), np.sqrt(1.0 - s / num)
    alpha, beta = 2.0 * np.pi * s / _PHI, 2.0 * np.pi * s / _PSI
    return np.stack(
        [r * np.sin(alpha), r * np.cos(alpha), big_r * np.sin(beta), big_r * np.cos(beta)], axis=1
    )


def quaternions_to_rotations(quaternions: FloatArray) -> FloatArray:
    """Return the rotation matrices of unit quaternions (w, x, y, z), shapes (..., 4) and (..., 3, 3)."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def random_rotations(dim: int, num: int, rng: np.random.Generator) -> FloatArray:
    """Return rotations drawn uniformly (Haar) from SO(d), shape (num, d, d): QR of Gaussian matrices."""
    q, r = np.linalg.qr(rng.standard_normal((num, dim, dim)))
    q = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[:, :, 0] *= np.sign(np.linalg.det(q))[:, None]
    return q


def principal_frame(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the principal axes of points about the origin as columns, largest first, shape (d, d), a rotation.

    The sign of every axis but the last is set by the third moment along it, which makes the frame rotate with the
    points wherever axes and moments are distinct.
    """
    axes = np.linalg.eigh(points.T @ (weights[:, None] * points))[1][:, ::-1]
    skewness = ((points @ axes) ** 3 * weights[:, None]).sum(axis=0)
    axes = axes * np.where(skewness < 0, -1.0, 1.0)
    axes[:, -1] *= np.sign(np.linalg.det(axes))
    return axes


def sign_rotations(dim: int, num: int, *, seed: int = 0) -> FloatArray:
    """Return diagonal matrices of signs with determinant +1, the identity first, shape (m, d, d).

    All 2^(d-1) of them where there are at most ``num``, else ``num`` distinct random ones.
    """
    if 2 ** (dim - 1) <= num:
        free = np.array(list(product([1.0, -1.0], repeat=dim - 1))).reshape(2 ** (dim - 1), dim - 1)
    else:
        drawn = np.random.default_rng(seed).choice([1.0, -1.0], size=(num, dim - 1))
        drawn[0] = 1.0
        _, first = np.unique(drawn, axis=0, return_index=True)
        free = drawn[np.sort(first)]
    last = free.prod(axis=1, keepdims=True)
    return np.concatenate([free, last], axis=1)[:, :, None] * np.eye(dim)


def small_rotations(dim: int, num: int, angle_rad: float, *, seed: int = 0) -> FloatArray:
    """Return rotations by one angle about even axes, shape (num, d, d): how to look around a pose.

    The axes are a Fibonacci sphere for d = 3 (d = 2 has two senses only); above, random generators of the same
    Frobenius norm. Cayley transform of skew-symmetric matrices.
    """
    upper = np.triu_indices(dim, 1)
    if dim == 2:
        generators = np.array([[1.0], [-1.0]])[np.arange(num) % 2]
    elif dim == 3:
        height = 1.0 - (2.0 * np.arange(num) + 1.0) / num
        azimuth = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(num)
        radius = np.sqrt(1.0 - height**2)
        generators = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1)
    else:
        generators = np.random.default_rng(seed).standard_normal((num, len(upper[0])))
        generators /= np.linalg.norm(generators, axis=1, keepdims=True)
    skew = np.zeros((len(generators), dim, dim))
    skew[:, upper[0], upper[1]] = np.tan(angle_rad / 2.0) * generators
    skew -= np.swapaxes(skew, 1, 2)
    identity = np.eye(dim)
    return np.asarray(np.linalg.solve(identity - skew, identity + skew), dtype=np.float64)
