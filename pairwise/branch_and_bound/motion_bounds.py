"""Bounds of the matching energy over rotations and shifts together, for points of which some may stay unmatched.

A cell is a ball of rotations R (angle r about R0) times a ball of shifts (radius s about t0). Source points p_j are
taken about an origin of their own, so t is the image of that origin. Two bounds are taken, and the larger one holds:

*Reach.* A point moves by at most d_j = s + 2 sin(r / 2) |p_j| within the cell, so a match costs at least
max(0, |R0 p_j + t0 - q_i| - d_j)^2 for every pose of the cell (Yang et al., Go-ICP, PAMI 2016). Each source point
takes its least cost, what it costs to leave it out included; that several may want one target point is ignored.

*Quasi-bound.* Let (R*, t*, m*) be a pose of energy E* in the cell that is best for its own map m*, which matches the
points M. For that fixed map the energy is |M| |t - t*(R)|^2 + E_c(R), with t*(R) = mean(q) - R mean(p) over M and E_c
the energy of the centred points. The first term at (R0, t0) is at most |M| (s + 2 sin(r / 2) |mean(p)|)^2, and
E_c(R0) - E_c(R*) <= 2 (1 - cos r) K as :mod:`pairwise.branch_and_bound.bounds` shows, with K = s1(P) s1(Q) +
s2(P) s2(Q) of *all* points: leaving points out and centring are projections, which raise no singular value. So

    E*  >=  min over maps of sum over matches (cost at (R0, t0) - (s + 2 sin(r / 2) L)^2)  -  2 (1 - cos r) K,

an assignment. L bounds |mean(p)|: with at most u points left out it is at most (|sum of all p| + the u longest) /
(n - u), and at most the longest. The bound holds for poses that are best for their own map, the optimum among them,
and loses second order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray
from pairwise.problem.problem import Problem

#: Assignments are solved to this share of what the cell's size loses anyway.
_SLACK_SHARE = 0.05
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionCells:
    """Balls of rotations times balls of shifts.

    Attributes
    ----------
    rotations : ndarray, shape (m, 3, 3)
    angles : ndarray, shape (m,)
        Radii of the balls of rotations, in radians.
    shifts : ndarray, shape (m, 3)
        Images of the source's origin.
    reaches : ndarray, shape (m,)
        Radii of the balls of shifts.
    """

    rotations: FloatArray
    angles: FloatArray
    shifts: FloatArray
    reaches: FloatArray

    def take(self, index: BoolArray) -> MotionCells:
        """Return some of the cells."""
        return MotionCells(
            rotations=self.rotations[index],
            angles=self.angles[index],
            shifts=self.shifts[index],
            reaches=self.reaches[index],
        )


class MotionBounds:
    """Bounds of one problem, its source taken about an origin.

    Parameters
    ----------
    problem : Problem
        In three dimensions, of unit weights.
    origin : ndarray, shape (3,)
        In the source's coordinates.
    most_unmatched : int
        How many source points the poses sought leave out at most.

    Attributes
    ----------
    num_columns : int
        The target points, and one more per source point that may stay unmatched.
    lever : float
        Greatest distance from the origin of the mean of source points of which at most so many are left out.
    """

    def __init__(self, problem: Problem, origin: FloatArray, most_unmatched: int) -> None:
        self.problem = problem
        self.source = np.ascontiguousarray(problem.source - origin)
        self._lengths = np.linalg.norm(self.source, axis=1)
        self.lever = _lever(self.source, most_unmatched)
        costs = (problem.target**2).sum(axis=1)[:, None] + self._lengths**2 + problem.constant_cost
        fixed = np.where(problem.allowed, costs, np.inf).T
        spare = np.full((problem.num_source, problem.max_unmatched), problem.unmatched_cost)
        self._fixed = np.ascontiguousarray(np.hstack([fixed, spare]))
        self._constant = np.ascontiguousarray(np.where(problem.allowed, problem.constant_cost, np.inf).T)
        self._rows = np.hstack([self.source, np.ones((problem.num_source, 1))])
        columns = np.hstack([problem.target, np.ones((problem.num_target, 1))])
        self._columns = np.ascontiguousarray(np.vstack([columns, np.zeros((problem.max_unmatched, 4))]).T)
        self.num_columns = self._fixed.shape[1]
        self._curvature = _curvature(problem)
        largest = np.where(np.isfinite(self._fixed), self._fixed, 0.0).max(axis=1)
        self._allowance = 64.0 * _EPS * float(largest.sum())

    def reach(self, cells: MotionCells) -> FloatArray:
        """Return by first order what every pose of each cell costs at least, shape (m,)."""
        from pairwise.branch_and_bound.reach import reach_bounds  # compiled, and loads Numba

        problem = self.problem
        return (
            reach_bounds(
                cells.rotations,
                cells.shifts,
                cells.reaches,
                2.0 * np.sin(0.5 * np.minimum(cells.angles, np.pi)),
                self.source,
                self._lengths,
                np.ascontiguousarray(problem.target),
                self._constant,
                problem.unmatched_cost,
                problem.max_unmatched,
            )
            - self._allowance
        )

    def quasi(
        self, cells: MotionCells, threshold: float, potentials: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bound what poses of each cell cost that are best for their own map.

        Parameters
        ----------
        cells : MotionCells
        threshold : float
            A bound above it is not improved further.
        potentials : ndarray, shape (m, N)
            To start from.

        Returns
        -------
        bounds : ndarray, shape (m,)
        energies : ndarray, shape (m,)
            At the cell's centre with some map, less its losses, where the bound is below the threshold, else ``inf``.
        potentials : ndarray, shape (m, N)
        """
        from pairwise.branch_and_bound.assignment import bound_assignments  # compiled, and loads Numba

        turn_loss, match_loss = self.losses(cells)
        turned_back = np.einsum("mba,mb->ma", cells.rotations, cells.shifts)
        turns = np.zeros((len(turn_loss), 4, 4))
        turns[:, :3, :3], turns[:, :3, 3] = -2.0 * cells.rotations, -2.0 * cells.shifts
        turns[:, 3, :3] = 2.0 * turned_back
        turns[:, 3, 3] = (cells.shifts**2).sum(axis=1) - match_loss
        wanted = threshold + turn_loss + self._allowance
        steps = _SLACK_SHARE * (turn_loss + match_loss) / self.num_columns + self._allowance
        values, energies, _, improved = bound_assignments(
            self._fixed,
            self._rows,
            self._columns,
            turns,
            potentials,
            np.arange(len(turns)),
            wanted,
            steps,
            np.ones(len(turns)),
        )
        return values - turn_loss - self._allowance, energies, improved

    def losses(self, cells: MotionCells) -> tuple[FloatArray, FloatArray]:
        """Return by how much turning towards the pose sought lowers the sum, and each match, shapes (m,)."""
        half = np.sin(0.5 * np.minimum(cells.angles, np.pi))
        turn = 4.0 * half**2 * self._curvature
        return np.asarray(turn), np.asarray((cells.reaches + 2.0 * half * self.lever) ** 2)


def _lever(source: FloatArray, most_unmatched: int) -> float:
    """Return how far from the origin the mean may be of all points but at most so many."""
    lengths = np.sort(np.linalg.norm(source, axis=1))[::-1]
    left_out = np.arange(min(most_unmatched, len(source) - 1) + 1)
    sums = np.linalg.norm(source.sum(axis=0)) + np.append(0.0, np.cumsum(lengths))[left_out]
    return float(min(lengths[0], (sums / (len(source) - left_out)).max()) * (1.0 + 64.0 * _EPS))


def _curvature(problem: Problem) -> float:
    """Return K of the module's text, about the centroids."""
    values = [
        np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[:2]
        for points in (problem.source, problem.target)
    ]
    return float(values[0] @ values[1] * (1.0 + 64.0 * _EPS))
