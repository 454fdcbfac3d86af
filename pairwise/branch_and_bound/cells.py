"""Cells of SO(2) and SO(3) for branch and bound: boxes that tile the rotations, each inside a ball of known radius.

SO(3) is the projective sphere of unit quaternions. Each of its four coordinates is the largest one somewhere; there
the others, divided by it, fill the cube [-1, 1]^3 (gnomonic projection), and ``x = tan(pi u / 4)`` makes cubes in u
nearly equal in size. Caps of the sphere are convex in the gnomonic projection, so the farthest point of a box from
its centre is a corner. SO(2) is the interval ``angle = pi u``.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from pairwise.local.rotation_sets import quaternions_to_rotations

#: Added to radii: covers the rounding of centres, corners and arc cosines.
_RADIUS_MARGIN = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """Boxes in the rotation group.

    Attributes
    ----------
    faces : ndarray of int, shape (m,)
        Which quaternion coordinate is the largest; 0 for d = 2.
    centres : ndarray, shape (m, c)
        Centres u in [-1, 1]^c; c is 3 for d = 3 and 1 for d = 2.
    halves : ndarray, shape (m,)
        Half the side of each box.
    """

    faces: IntArray
    centres: FloatArray
    halves: FloatArray

    @classmethod
    def whole(cls, dim: int) -> Cells:
        """Return the boxes that tile all rotations of dimension 2 or 3."""
        faces = np.arange(4 if dim == 3 else 1)
        return cls(faces=faces, centres=np.zeros((len(faces), dim * (dim - 1) // 2)), halves=np.ones(len(faces)))

    def __len__(self) -> int:
        return len(self.faces)

    def take(self, index: IntArray) -> Cells:
        """Return the cells at the given positions."""
        return Cells(faces=self.faces[index], centres=self.centres[index], halves=self.halves[index])

    def split(self) -> Cells:
        """Halve every side: 8 (or 2) children of each cell, those of one cell next to each other."""
        offsets = _signs(self.centres.shape[1])
        centres = self.centres[:, None] + 0.5 * self.halves[:, None, None] * offsets
        return Cells(
            faces=np.repeat(self.faces, len(offsets)),
            centres=centres.reshape(-1, offsets.shape[1]),
            halves=np.repeat(0.5 * self.halves, len(offsets)),
        )

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Return rotations (m, d, d) and angles in radians (m,): every rotation of a cell is that near to its own."""
        if self.centres.shape[1] == 1:
            angles = np.pi * self.centres[:, 0]
            cos, sin = np.cos(angles), np.sin(angles)
            rotations = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
            return rotations, np.pi * self.halves + _RADIUS_MARGIN
        middle = _quaternions(self.faces, self.centres)
        corners = (self.centres[:, None] + self.halves[:, None, None] * _signs(3)).reshape(-1, 3)
        far = _quaternions(np.repeat(self.faces, 8), corners).reshape(len(self), 8, 4)
        chords = np.linalg.norm(far - middle[:, None], axis=2).max(axis=1)
        return quaternions_to_rotations(middle), 4.0 * np.arcsin(0.5 * chords) + _RADIUS_MARGIN


def join(parts: list[Cells]) -> Cells:
    """Return all cells of all parts."""
    return Cells(
        faces=np.concatenate([p.faces for p in parts]),
        centres=np.concatenate([p.centres for p in parts]),
        halves=np.concatenate([p.halves for p in parts]),
    )


def _signs(dim: int) -> FloatArray:
    return np.array(list(product([-1.0, 1.0], repeat=dim)))


def _quaternions(faces: IntArray, centres: FloatArray) -> FloatArray:
    """Return the unit quaternions of points in the cubes, the coordinate of the face being positive."""
    quaternions = np.ones((len(faces), 4))
    others = np.array([[c for c in range(4) if c != face] for face in range(4)])
    np.put_along_axis(quaternions, others[faces], np.tan(0.25 * np.pi * centres), axis=1)
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
