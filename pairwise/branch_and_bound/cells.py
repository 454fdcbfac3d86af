"""Cells of SO(2) and SO(3) for branch and bound: boxes that tile the rotations, each inside a ball of known radius.

SO(3) is the projective sphere of unit quaternions. Each of its four coordinates is the largest one somewhere; there
the others, divided by it, fill the cube [-1, 1]^3 (gnomonic projection), and ``x = tan(pi u / 4)`` makes cubes in u
nearly equal in size. Caps of the sphere are convex in the gnomonic projection, so the farthest point of a box from
its centre is a corner. SO(2) is the interval ``angle = pi u``.

Cells are halved along one axis after the other, so a cell is named by its face and the bits of its path: which half
at each split. The leaves of a tree of halvings tile the group exactly when the intervals
``[path, path + 1) / 2^depth`` of each face tile [0, 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from data_tools.arrays import FloatArray, IntArray, Rows
from pairwise.local.rotation_sets import quaternions_to_rotations

#: Added to radii: covers the rounding of centres, corners and arc cosines.
_RADIUS_MARGIN = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells(Rows):
    """Boxes in the rotation group.

    Attributes
    ----------
    faces : ndarray of int, shape (m,)
        Which quaternion coordinate is the largest; 0 for d = 2.
    depths : ndarray of int, shape (m,)
        How often the face was halved.
    paths : ndarray of int, shape (m,)
        The halves taken, as the bits of a number, the first split's bit the highest.
    centres, halves : ndarray, shape (m, c)
        Centres u in [-1, 1]^c and half the sides of each box; c is 3 for d = 3 and 1 for d = 2.
    """

    faces: IntArray
    depths: IntArray
    paths: IntArray
    centres: FloatArray
    halves: FloatArray

    @classmethod
    def whole(cls, dim: int) -> Cells:
        """Return the boxes that tile all rotations of dimension 2 or 3."""
        num, axes = (1, 1) if dim == 2 else (4, 3)
        zeros = np.zeros(num, dtype=np.int64)
        return cls(
            faces=np.arange(num),
            depths=zeros,
            paths=zeros,
            centres=np.zeros((num, axes)),
            halves=np.ones((num, axes)),
        )

    def split(self) -> Cells:
        """Halve each cell along the axis whose turn it is: two children of each cell, next to each other."""
        axes, rows = self.depths % self.centres.shape[1], np.arange(len(self))
        halves = self.halves.copy()
        halves[rows, axes] *= 0.5
        centres = np.repeat(self.centres, 2, axis=0)
        step = halves[rows, axes]
        centres[2 * rows, axes] -= step
        centres[2 * rows + 1, axes] += step
        paths = np.repeat(2 * self.paths, 2)
        paths[1::2] += 1
        return Cells(
            faces=np.repeat(self.faces, 2),
            depths=np.repeat(self.depths + 1, 2),
            paths=paths,
            centres=centres,
            halves=np.repeat(halves, 2, axis=0),
        )

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Return rotations (m, d, d) and angles in radians (m,): every rotation of a cell is that near to its own."""
        rotations, reach = self.reach()
        return rotations, radii_of(reach)

    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Return rotations R (m, d, d), and by what the corners turn against them: v = sin(theta / 2) a, (m, c, 3).

        A corner is R exp(theta [a]); one of d = 2 rotates about the third axis.
        """
        if self.centres.shape[1] == 1:
            angles = np.pi * self.centres[:, 0]
            cos, sin = np.cos(angles), np.sin(angles)
            rotations = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
            return rotations, np.sin(0.5 * np.pi * self.halves[:, :, None]) * np.array([0.0, 0.0, 1.0])
        middle = _quaternions(self.faces, self.centres)
        corners = (self.centres[:, None] + self.halves[:, None] * _SIGNS).reshape(-1, 3)
        far = _quaternions(np.repeat(self.faces, 8), corners).reshape(len(self), 8, 4)
        return quaternions_to_rotations(middle), np.einsum("mab,mcb->mca", _vector_parts(middle), far)


def radii_of(reach: FloatArray) -> FloatArray:
    """Return the angles in radians (m,) of the farthest corners, see :meth:`Cells.reach`."""
    sines = np.minimum(np.sqrt((reach**2).sum(axis=2).max(axis=1)), 1.0)
    return np.asarray(np.minimum(2.0 * np.arcsin(sines) + _RADIUS_MARGIN, np.pi))


#: The corners of a box around its centre.
_SIGNS = np.array(list(product([-1.0, 1.0], repeat=3)))
#: The coordinates of a quaternion other than that of its face.
_OTHERS = np.array([[c for c in range(4) if c != face] for face in range(4)])


def _quaternions(faces: IntArray, centres: FloatArray) -> FloatArray:
    """Return the unit quaternions of points in the cubes, the coordinate of the face being positive."""
    quaternions = np.ones((len(faces), 4))
    np.put_along_axis(quaternions, _OTHERS[faces], np.tan(0.25 * np.pi * centres), axis=1)
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)


def _vector_parts(quaternions: FloatArray) -> FloatArray:
    """Return the matrices (m, 3, 4) that take q to the vector part of p^-1 q, for unit quaternions p (m, 4)."""
    w, x, y, z = quaternions.T
    rows = [[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
