"""Quasi-bounds: lower bounds of the matching energy over a cell of rotations *if the optimum lies in the cell*.

Let F(R) = min over maps of E(R, map), and let (R*, m*) be a pose of energy E* with R* best for its own map m*. For
that fixed map E(., m*) = const - 2 <., M>, M = sum_j w_j q_m*(j) p_j^T, and R* is its minimum over the rotations, so
S = R*^T M is symmetric and for R0 = R* exp(theta [a])

    E(R0, m*) - E* = 4 sum_j w_j <v x p_j, v x R*^T q_m*(j)>  <=  4 |v x P| |v x R0^T Q|,    v = sin(theta / 2) a,

by Cauchy and Schwarz, |v x P| being the norm of all w_j v x p_j, and because R* a = R0 a. So if R* lies in a cell
around R0, then E* >= F(R0) less the largest right-hand side of the cell (Dym and Kovalsky, "Linearly converging quasi
branch and bound algorithms for global rigid registration", ICCV 2019, with a constant instead, the same about every
axis). It is a quadratic form of v at most, which is largest at a corner. This is no lower bound of F over the cell.
It holds for the optimum and for every other pose that is best for its own map, which is all that pruning needs, and
it loses r^2 where bounds over a ball of radius r lose r.

Only "m* is fixed" is used: allowed matches, constant costs, weights and k < n change nothing.

**Cells** of SO(2) and SO(3) are boxes that tile the rotations, each inside a ball of known radius.
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

from data_tools.arrays import BoolArray, FloatArray, IntArray, Rows
from pairwise.certificates.verify_cells import REACH_MARGIN
from pairwise.problem import Problem
from pairwise.rotation_sets import quaternions_to_rotations

#: Added to radii: covers the rounding of centres, corners and arc cosines.
_RADIUS_MARGIN = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells(Rows):
    """The cells of branch and bound: boxes in the rotation group.

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
        """Return rotations R (m, d, d), and those of the corners against them: v = sin(theta / 2) a, (m, c, 3).

        A corner is R exp(theta [a]); one of d = 2 rotates about the third axis.
        """
        if self.centres.shape[1] == 1:
            angles = np.pi * self.centres[:, 0]
            cos, sin = np.cos(angles), np.sin(angles)
            rotations = np.stack(
                [np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1
            )
            return rotations, np.sin(0.5 * np.pi * self.halves[:, :, None]) * np.array(
                [0.0, 0.0, 1.0]
            )
        middle = _quaternions(self.faces, self.centres)
        corners = (self.centres[:, None] + self.halves[:, None] * _SIGNS).reshape(-1, 3)
        far = _quaternions(np.repeat(self.faces, 8), corners).reshape(len(self), 8, 4)
        return quaternions_to_rotations(middle), np.einsum(
            "mab,mcb->mca", _vector_parts(middle), far
        )


def radii_of(reach: FloatArray) -> FloatArray:
    """Return the angles in radians (m,) of the farthest corners of cells, see :meth:`Cells.reach`."""
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


#: Assignments are solved to this share of what the cell's size loses anyway.
_SLACK_SHARE = 0.05
#: Maps that are remembered.
_NUM_KEPT = 256
_EPS = float(np.finfo(np.float64).eps)


class QuasiBounds:
    """Quasi-bounds of one problem over SO(2) or SO(3).

    Maps that were met are kept with their potentials: as a function of the rotation the energy of each is linear, so
    that they say at once which cells cannot be settled yet, and the best of them has potentials to start from.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        weights = problem.weights
        squares = weights * (problem.source**2).sum(axis=1)
        costs = weights * (problem.target**2).sum(axis=1)[:, None] + squares + problem.constant_cost
        self._fixed = np.ascontiguousarray(np.where(problem.allowed, costs, np.inf))
        source, target = _in_space(weights[:, None] * problem.source), _in_space(problem.target)
        self._source, self._target = np.ascontiguousarray(-2.0 * source.T), target.T
        self._curvature = Curvature(source.T @ source, target.T @ target)
        largest = np.where(np.isfinite(self._fixed), np.abs(self._fixed), 0.0).max(axis=0)
        self._allowance = 32.0 * _EPS * float(largest.sum() + 2.0 * squares.sum())
        self._constants, self._moments = np.full(_NUM_KEPT, np.inf), np.zeros((_NUM_KEPT, 9))
        self._potentials, self._num_met = np.zeros((_NUM_KEPT, problem.num_target)), 0

    def __call__(
        self, rotations: FloatArray, reach: FloatArray, threshold: float
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        """Bound the energies of the poses in cells, but of those whose bound could not exceed the threshold.

        Parameters
        ----------
        rotations : ndarray, shape (m, d, d)
        reach : ndarray, shape (m, c, 3)
            How far the corners are, see :meth:`pairwise.branch_and_bound.bounds.Cells.reach`.
        threshold : float
            A bound need not be larger.

        Returns
        -------
        bounds : ndarray, shape (m,)
            Poses of the cell that are best for their own map have at least that energy; where nothing is proven, what
            could be at most.
        losses : ndarray, shape (m,)
            What of the energy at the cell's rotation it takes off.
        is_proven : ndarray of bool, shape (m,)
        energies : ndarray, shape (m,)
            Energy of some map at the cell's rotation, ``inf`` where none was needed.
        """
        from pairwise.branch_and_bound.assignment import bound_assignments

        matrices = np.zeros((len(rotations), 3, 3))
        matrices[:, : self.problem.dim, : self.problem.dim] = rotations
        losses = self._curvature.losses(matrices, reach) + self._allowance
        met = self._moments @ matrices.reshape(-1, 9).T + self._constants[:, None]
        best = met.argmin(axis=0)
        energies = met[best, np.arange(len(matrices))]
        bounds = energies - losses
        tried = np.flatnonzero(bounds > threshold)
        values, found, moments = bound_assignments(
            self._fixed,
            self._source,
            np.swapaxes(matrices[tried], 1, 2) @ self._target,
            potentials := self._potentials[best[tried]],
            threshold + losses[tried],
            _SLACK_SHARE * losses[tried] / self.problem.num_target,
        )
        bounds[tried] = values - losses[tried]
        energies[tried] = np.minimum(energies[tried], found)
        is_proven = np.zeros(len(matrices), dtype=np.bool_)
        is_proven[tried] = True
        self._keep(matrices[tried], found, matrices[tried] @ moments, potentials)
        return bounds, losses, is_proven, energies

    def _keep(
        self,
        matrices: FloatArray,
        energies: FloatArray,
        moments: FloatArray,
        potentials: FloatArray,
    ) -> None:
        """Remember the maps of finite energy, the last ones if they are many."""
        new = np.flatnonzero(np.isfinite(energies))[-_NUM_KEPT:]
        at = (self._num_met + np.arange(len(new))) % _NUM_KEPT
        self._constants[at] = energies[new] - (moments[new] * matrices[new]).sum(axis=(1, 2))
        self._moments[at], self._potentials[at] = moments[new].reshape(-1, 9), potentials[new]
        self._num_met += len(new)


class Curvature:
    """By how much the energy of a map may fall within a cell, towards the rotation that is best for it.

    Parameters
    ----------
    source, target : ndarray, shape (3, 3)
        Sums of ``w_j^2 p_j p_j^T`` and of ``q_i q_i^T``.
    """

    def __init__(self, source: FloatArray, target: FloatArray) -> None:
        traces = np.trace(source), np.trace(target)
        balance = float(np.sqrt(traces[1] / traces[0])) if min(traces) > 0.0 else 1.0
        self._source = 2.0 * balance * (traces[0] * np.eye(3) - source) + 2.0 / balance * traces[
            1
        ] * np.eye(3)
        self._target = 2.0 / balance * target
        own, other = np.linalg.eigvalsh(self._source), np.linalg.eigvalsh(self._target)
        self._least, self._most = own[0] - other[-1], own[-1] - other[0]

    def losses(self, matrices: FloatArray, reach: FloatArray) -> FloatArray:
        """Return how much that is at most, for rotations (m, 3, 3) and corners (m, c, 3), shape (m,)."""
        forms = self._source - np.swapaxes(matrices, 1, 2) @ self._target @ matrices
        levels = ((reach @ forms) * reach).sum(axis=2).max(axis=1)
        largest = self._most * (reach**2).sum(axis=2).max(axis=1)
        level = np.where(levels <= self._least, levels, largest)
        return np.asarray(
            (np.sqrt(level) + REACH_MARGIN * np.sqrt(self._most)) ** 2 * (1.0 + 64.0 * _EPS)
        )


def _in_space(points: FloatArray) -> FloatArray:
    """Return points (l, d) with zeros for the coordinates that they lack, shape (l, 3)."""
    return np.hstack([points, np.zeros((len(points), 3 - points.shape[1]))])
