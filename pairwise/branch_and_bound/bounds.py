"""Quasi-bounds: lower bounds of the matching energy over a ball of rotations *if the optimum lies in the ball*.

Let F(R) = min over maps of E(R, map), and let (R*, m*) be a pose of energy E* with R* best for its own map m*. For
that fixed map E(., m*) = const - 2 <., M>, M = sum_j w_j q_m*(j) p_j^T, and R* is its minimum over the rotations, so
S = R*^T M is symmetric and for R0 = R* exp(theta [a])

    E(R0, m*) - E* = 2 (1 - cos theta) (tr S - a^T S a)  <=  2 (1 - cos theta) K,    K = s1(P) s1(Q) + s2(P) s2(Q),

by von Neumann's trace inequality (s1 >= s2 singular values of the weighted source and of the target as matrices). So
if R* lies within the angle r of R0, then E* >= F(R0) - 2 (1 - cos r) K (Dym and Kovalsky, "Linearly converging quasi
branch and bound algorithms for global rigid registration", ICCV 2019, with a smaller constant). This is no lower
bound of F over the ball. It holds for the optimum and for every other pose that is best for its own map, which is all
that pruning needs, and it loses r^2 where bounds over the ball lose r.

Only "m* is fixed" is used: allowed matches, constant costs, weights and k < n change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray
from pairwise.problem.problem import Problem

#: Assignments are solved to this share of what the radius loses anyway.
_SLACK_SHARE = 0.05
#: Cells of more than this radius are split rather than solved where this share of what is left to gain is not enough.
_LARGE_RAD, _OPTIMISM = 0.35, 0.5
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, kw_only=True, eq=False)
class CellBounds:
    """What is known about some cells.

    Attributes
    ----------
    bounds : ndarray, shape (m,)
        Poses of the cell that are best for their own map have at least that energy.
    energies : ndarray, shape (m,)
        Energy of some map at the cell's rotation where the bound is below the threshold, else ``inf``.
    is_improved : ndarray of bool, shape (m,)
        Whether the given potentials were not enough.
    potentials : ndarray, shape (m, n)
        What proves the bounds.
    """

    bounds: FloatArray
    energies: FloatArray
    is_improved: BoolArray
    potentials: FloatArray


class QuasiBounds:
    """Quasi-bounds of one problem over SO(2) or SO(3).

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        weights = problem.weights
        squares = weights * (problem.source**2).sum(axis=1)
        costs = weights * (problem.target**2).sum(axis=1)[:, None] + squares + problem.constant_cost
        self._fixed = np.ascontiguousarray(np.where(problem.allowed, costs, np.inf).T)
        self._source = _in_space(-2.0 * weights[:, None] * problem.source)
        self._target = np.ascontiguousarray(_in_space(problem.target).T)
        self._curvature = _curvature(problem)
        largest = np.where(np.isfinite(self._fixed), np.abs(self._fixed), 0.0).max(axis=1)
        self._allowance = 32.0 * _EPS * float(largest.sum() + 2.0 * squares.sum())

    def __call__(
        self,
        rotations: FloatArray,
        radii: FloatArray,
        threshold: float,
        potentials: FloatArray,
        starts: IntArray,
    ) -> CellBounds:
        """Bound the energies of the poses in balls; stop improving a bound once it exceeds the threshold.

        Parameters
        ----------
        rotations : ndarray, shape (m, d, d)
        radii : ndarray, shape (m,)
            In radians.
        threshold : float
        potentials : ndarray, shape (t, n)
        starts : ndarray of int, shape (m,)
            Which potentials to start from.
        """
        from pairwise.branch_and_bound.assignment import bound_assignments

        loss = self.loss(radii)
        turns = np.zeros((len(rotations), 3, 3))
        turns[:, : self.problem.dim, : self.problem.dim] = rotations
        values, energies, is_improved, improved = bound_assignments(
            self._fixed,
            self._source,
            self._target,
            turns,
            potentials,
            starts,
            threshold + loss + self._allowance,
            _SLACK_SHARE * self._curvature * _chord(radii) / self.problem.num_target,
            np.where(radii > _LARGE_RAD, _OPTIMISM, 1.0),
        )
        return CellBounds(
            bounds=values - self._allowance - loss, energies=energies, is_improved=is_improved, potentials=improved
        )

    def loss(self, radii: FloatArray) -> FloatArray:
        """Return 2 (1 - cos r) K, by how much F may fall within each radius towards the pose that is sought."""
        return _chord(radii) * self._curvature


def _chord(radii: FloatArray) -> FloatArray:
    """Return 2 (1 - cos r)."""
    return np.asarray(4.0 * np.sin(0.5 * np.minimum(radii, np.pi)) ** 2)


def _curvature(problem: Problem) -> float:
    """Return K: half the largest curvature of the energy with a fixed map at the rotation best for that map."""
    source = np.linalg.svd(problem.weights[:, None] * problem.source, compute_uv=False)
    target = np.linalg.svd(problem.target, compute_uv=False)
    num = min(len(source), len(target), 2)
    return float(source[:num] @ target[:num] * (1.0 + 64.0 * _EPS))


def _in_space(points: FloatArray) -> FloatArray:
    """Return points (l, d) with zeros for the coordinates that they lack, shape (l, 3)."""
    return np.hstack([points, np.zeros((len(points), 3 - points.shape[1]))])
