"""The lifted rotation of the tight relaxation: which matrices M = E[z z^T] a rotation can give, and R read off them.

Two lifts for each of d = 3 and d = 2, both linear in a small positive semidefinite matrix:

========== === ==== =============================== ============================================================
form        d  size z                                identities that every ``z z^T`` satisfies
========== === ==== =============================== ============================================================
tight       3   10  (1, R11, R21, ..., R33)          R R^T = I, R^T R = I, cof(R) = R: 20 independent ones
tight       2    3  (1, cos, sin)                    cos^2 + sin^2 = 1
quaternion  3    4  unit quaternion (w, x, y, z)     none; R is linear in ``z z^T``
quaternion  2    2  (cos, sin) of half the angle     none
========== === ==== =============================== ============================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import null_space

from data_tools.arrays import FloatArray
from data_tools.errors import OptionsError


@dataclass(frozen=True, kw_only=True, eq=False)
class Lift:
    """A lifted rotation ``z(R)`` and the span V of all ``z z^T`` in the symmetric matrices.

    Attributes
    ----------
    form : {"tight", "quaternion"}
    dim : int
        d, the size of R.
    entries : ndarray, shape (d * d, s, s)
        Symmetric matrices with ``<entries[a], z z^T> = [R]_a``, column-major.
    identities : ndarray, shape (c, s, s)
        Symmetric matrices with ``<identities[c], z z^T> = 0`` for every rotation; linearly independent.
    trace : float
        ``|z|^2``, the same for every rotation.
    """

    form: str
    dim: int
    entries: FloatArray
    identities: FloatArray
    trace: float

    @property
    def size(self) -> int:
        """Number s of rows of the blocks."""
        return self.entries.shape[1]

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis of V, shape (m, s, s): the symmetric matrices orthogonal to every identity."""
        s = self.size
        rows, cols = np.triu_indices(s)
        units = np.zeros((len(rows), s, s))
        units[np.arange(len(rows)), rows, cols] += 0.5
        units[np.arange(len(rows)), cols, rows] += 0.5
        units /= np.linalg.norm(units, axis=(1, 2))[:, None, None]
        if not len(self.identities):
            return units
        products = np.tensordot(self.identities, units, axes=([1, 2], [1, 2]))
        return np.ascontiguousarray(np.tensordot(null_space(products).T, units, axes=1))

    @cached_property
    def flat_basis(self) -> FloatArray:
        """The basis as a matrix, shape (s * s, m): ``flat_basis @ x`` is a block, its transpose projects on V."""
        return np.ascontiguousarray(self.basis.reshape(len(self.basis), -1).T)

    @cached_property
    def one(self) -> FloatArray:
        """The functional that is 1 at every rotation, as coordinates in V, shape (m,)."""
        return np.trace(self.basis, axis1=1, axis2=2) / self.trace

    @cached_property
    def linear(self) -> FloatArray:
        """The functionals [R]_a as coordinates in V, shape (d * d, m)."""
        return np.tensordot(self.entries, self.basis, axes=([1, 2], [1, 2]))

    def cost_coordinates(self, constants: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return the functionals ``constants + <slopes, R>`` as coordinates in V.

        Parameters
        ----------
        constants : ndarray, shape (...,)
        slopes : ndarray, shape (..., d, d)

        Returns
        -------
        ndarray, shape (..., m)
        """
        columns = np.swapaxes(slopes, -1, -2).reshape(*slopes.shape[:-2], -1)
        return constants[..., None] * self.one + columns @ self.linear

    def mean_rotations(self, blocks: FloatArray) -> FloatArray:
        """Return the mean rotations (times the mass) of blocks (..., s, s), shape (..., d, d)."""
        columns = blocks.reshape(*blocks.shape[:-2], -1) @ self.entries.reshape(len(self.entries), -1).T
        return np.swapaxes(columns.reshape(*blocks.shape[:-2], self.dim, self.dim), -1, -2)

    def vectors(self, rotations: FloatArray) -> FloatArray:
        """Return z(R) of rotations (..., d, d), shape (..., s); the sign of a quaternion is arbitrary."""
        if self.form == "quaternion":
            return _spin_vectors(rotations)
        columns = np.swapaxes(rotations, -1, -2).reshape(*rotations.shape[:-2], -1)
        used = columns if self.dim == 3 else columns[..., :2]
        return np.concatenate([np.ones((*used.shape[:-1], 1)), used], axis=-1)

    def full_moments(self, block: FloatArray) -> FloatArray:
        """Return E[(1, [R]) (1, [R])^T] of one block (s, s), shape (1 + d * d, 1 + d * d).

        A quaternion block does not determine these moments: they are those of its spectral measure, the rotations
        of its eigenvectors weighted with its eigenvalues, which is one measure that the block represents.
        """
        if self.form == "quaternion":
            weights, vectors = np.linalg.eigh(block)
            columns = np.swapaxes(self.mean_rotations(_outer(vectors.T)), -1, -2).reshape(self.size, -1)
            z = np.hstack([np.ones((self.size, 1)), columns])
            return (z.T * np.maximum(weights, 0.0)) @ z
        spread = np.zeros((1 + self.dim**2, self.size))
        spread[0, 0] = 1.0
        spread[1:] = 2.0 * self.entries[:, 0, :]
        return spread @ block @ spread.T


@cache
def make_lift(form: str, dim: int) -> Lift:
    """Return the lift of that form for rotations in dimension 2 or 3.

    Raises
    ------
    OptionsError
        If the form is unknown, or d is neither 2 nor 3.
    """
    if form not in ("tight", "quaternion"):
        raise OptionsError(f"form: expected 'tight' or 'quaternion', got {form!r}")
    if dim not in (2, 3):
        raise OptionsError(f"the {form} relaxation is for points in dimension 2 or 3, these have {dim}")
    if form == "quaternion":
        entries = _spin_entries(dim)
        none = np.zeros((0, *entries.shape[1:]))
        return Lift(form=form, dim=dim, entries=entries, identities=none, trace=1.0)
    if dim == 2:
        return Lift(
            form=form, dim=2, entries=_plane_entries(), identities=np.diag([1.0, -1.0, -1.0])[None], trace=2.0
        )
    entries = np.zeros((9, 10, 10))
    for a in range(9):
        entries[a, 0, a + 1] = entries[a, a + 1, 0] = 0.5
    return Lift(form=form, dim=3, entries=entries, identities=rotation_identities(), trace=4.0)


def rotation_identities() -> FloatArray:
    """Return the 20 independent quadratic identities of SO(3) on z = (1, vec R), shape (20, 10, 10).

    In this order: the six R R^T = I (upper triangle, row by row), five of R^T R = I (all but the last, which the
    traces imply), and the nine cof(R) = R, column by column.
    """
    index = 1 + np.arange(9).reshape(3, 3).T
    identities = []
    for vectors in (index, index.T):
        for a, b in combinations_with_replacement(range(3), 2):
            identities.append(_quadratic([(u, v, 1.0) for u, v in zip(vectors[a], vectors[b], strict=True)], a == b))
    del identities[11]
    for column in range(3):
        u, v = index[:, (column + 1) % 3], index[:, (column + 2) % 3]
        for row in range(3):
            a, b = (row + 1) % 3, (row + 2) % 3
            minor = [(u[a], v[b], 1.0), (u[b], v[a], -1.0), (0, index[row, column], -1.0)]
            identities.append(_quadratic(minor, False))
    return np.array(identities)


def _quadratic(terms: list[tuple[int, int, float]], minus_one: bool) -> FloatArray:
    """Return the symmetric matrix of a sum of products of coordinates of z, less z0^2 if asked."""
    matrix = np.zeros((10, 10))
    for a, b, factor in terms:
        matrix[a, b] += 0.5 * factor
        matrix[b, a] += 0.5 * factor
    matrix[0, 0] -= float(minus_one)
    return matrix


def _plane_entries() -> FloatArray:
    """Return <entries[a], z z^T> = [R]_a for z = (1, cos, sin)."""
    entries = np.zeros((4, 3, 3))
    for a, (position, sign) in enumerate([(1, 0.5), (2, 0.5), (2, -0.5), (1, 0.5)]):
        entries[a, 0, position] = entries[a, position, 0] = sign
    return entries


def _spin_entries(dim: int) -> FloatArray:
    """Return the matrices that give [R] from the (half-angle or quaternion) block, column-major."""
    if dim == 2:
        cosine, sine = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
        return np.array([cosine, sine, -sine, cosine])
    rotation = np.zeros((3, 3, 4, 4))
    for a in range(3):
        diagonal = np.full(4, -1.0)
        diagonal[[0, a + 1]] = 1.0
        rotation[a, a] = np.diag(diagonal)
        b, c = (a + 1) % 3, (a + 2) % 3
        for row, col, sign in ((b, c, -1.0), (c, b, 1.0)):
            rotation[row, col, b + 1, c + 1] = rotation[row, col, c + 1, b + 1] = 1.0
            rotation[row, col, 0, a + 1] = rotation[row, col, a + 1, 0] = sign
    return np.ascontiguousarray(rotation.transpose(1, 0, 2, 3).reshape(9, 4, 4))


def _spin_vectors(rotations: FloatArray) -> FloatArray:
    """Return unit half-angle vectors or quaternions: the leading eigenvector of the linear inverse of the lift."""
    dim = rotations.shape[-1]
    entries = _spin_entries(dim)
    columns = np.swapaxes(rotations, -1, -2).reshape(*rotations.shape[:-2], -1)
    blocks = np.tensordot(columns, entries, axes=1)
    return np.linalg.eigh(blocks)[1][..., -1]


def _outer(vectors: FloatArray) -> FloatArray:
    return vectors[..., :, None] * vectors[..., None, :]
