"""Lower bounds of the matching energy over balls of rotations, for many balls at once.

Let a ball be {R : angle(R, R0) <= r} and let t_j be any points (the reference). For every R in it and every map,

    E(R, map) = sum_j w_j |p_j|^2 - 2 sum_j w_j <t_j, R p_j>                                        (rotation part)
                + sum_j [ w_j |q_map(j)|^2 + c - 2 w_j <q_map(j) - t_j, R p_j> ]                     (matching part)

The rotation part has a closed-form bound over the ball; in the matching part each bracket is smallest where R p_j
is the point of the spherical cap of radius r about R0 p_j that is nearest to the direction q_i - t_j, which leaves
an assignment problem. With t = 0 this is the usual bound that moves every point on its own; with t_j the image of
p_j under the best map at R0 it is exact as soon as that map stays best in the whole ball, so that the ball around
the optimum is settled at a positive radius instead of being split for ever. In between, every multiple of that
reference gives a valid bound.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import FloatArray, IntArray
from pairwise.problem import Problem
from pairwise.tight_lift import make_lift
from pairwise.tight_problem import energy_scale

#: Multiples of the map's images that serve as reference, in the order of their use.
REFERENCES = (0.4, 0.75, 1.0)
#: Numbers that may be held at once.
_CHUNK_NUMBERS = 400_000
_EPS = float(np.finfo(np.float64).eps)


class BallBounds:
    """Bounds for one problem over SO(2) or SO(3).

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._lengths = np.sqrt((problem.source**2).sum(axis=1))
        self._fixed = problem.weights * (problem.target**2).sum(axis=1)[:, None] + problem.constant_cost
        self._fixed = np.where(problem.candidates, self._fixed, np.inf)
        self._total = float((problem.weights * self._lengths**2).sum())
        self._spin = make_lift("quaternion", problem.dim).entries
        self._allowance = 64.0 * _EPS * (problem.num_target + problem.num_source) ** 2 * energy_scale(problem)
        numbers = problem.num_target * problem.num_source * problem.dim
        self.chunk = max(1, _CHUNK_NUMBERS // numbers)

    def __call__(
        self, rotations: FloatArray, radii: FloatArray, threshold: float
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Bound the energy over balls; stop improving a bound once it exceeds the threshold.

        Parameters
        ----------
        rotations : ndarray, shape (m, d, d)
        radii : ndarray, shape (m,)
            In radians.
        threshold : float

        Returns
        -------
        bounds : ndarray, shape (m,)
        energies : ndarray, shape (m,)
            At the balls' centres, each with its best map.
        maps : ndarray of int, shape (m, k)
            These maps.
        """
        parts = [
            self._chunk(rotations[first : first + self.chunk], radii[first : first + self.chunk], threshold)
            for first in range(0, len(rotations), self.chunk)
        ]
        bounds, energies, maps = zip(*parts, strict=True)
        return np.concatenate(bounds), np.concatenate(energies), np.concatenate(maps)

    def _chunk(
        self, rotations: FloatArray, radii: FloatArray, threshold: float
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        problem = self.problem
        moved = problem.source @ np.swapaxes(rotations, 1, 2)
        costs = self._fixed - 2.0 * problem.weights * (problem.target @ np.swapaxes(moved, 1, 2))
        energies, maps = _assign(costs)
        bounds = np.full(len(rotations), -np.inf)
        open_balls = np.arange(len(rotations))
        for multiple in REFERENCES:
            reference = multiple * problem.target[maps[open_balls]]
            improved = self._rotation_part(rotations[open_balls], radii[open_balls], reference)
            improved += self._matching_part(moved[open_balls], radii[open_balls], reference)
            bounds[open_balls] = np.maximum(bounds[open_balls], improved - self._allowance)
            open_balls = open_balls[bounds[open_balls] <= threshold]
            if not len(open_balls):
                break
        return bounds, energies + self._total, maps

    def _rotation_part(self, rotations: FloatArray, radii: FloatArray, reference: FloatArray) -> FloatArray:
        """Bound ``sum_j w_j |p_j|^2 - 2 <T, R>`` with T = sum_j w_j t_j p_j^T from below over each ball.

        With R = R0 exp(theta [a]) and G = R0^T T: <T, R> = tr G + sin(theta) g.a - (1 - cos(theta)) (tr G - a^T G
        a), g the axial vector of G; bounding g.a and a^T G a apart leaves one sinusoid in theta. Over all rotations
        the maximum is the largest eigenvalue of the quaternion form, and the smaller of the two bounds counts.
        """
        problem = self.problem
        attraction = np.swapaxes(reference, 1, 2) @ (problem.weights[:, None] * problem.source)
        turned = np.swapaxes(rotations, 1, 2) @ attraction
        trace = np.trace(turned, axis1=1, axis2=2)
        skew = turned - np.swapaxes(turned, 1, 2)
        slope = np.sqrt(0.5 * (skew**2).sum(axis=(1, 2)))
        bend = trace
        if problem.dim == 3:
            bend = trace - np.linalg.eigvalsh(0.5 * (turned + np.swapaxes(turned, 1, 2)))[:, -1]
        inside = np.arctan2(slope, bend) <= radii
        at_edge = slope * np.sin(radii) - bend * (1.0 - np.cos(radii))
        nearby = trace + np.where(inside, np.hypot(slope, bend) - bend, at_edge)
        columns = np.swapaxes(attraction, 1, 2).reshape(len(attraction), -1)
        anywhere = np.linalg.eigvalsh(np.tensordot(columns, self._spin, axes=1))[:, -1]
        return self._total - 2.0 * np.minimum(nearby, anywhere)

    def _matching_part(self, moved: FloatArray, radii: FloatArray, reference: FloatArray) -> FloatArray:
        """Return the assignment of the brackets, each at its smallest over the cap of its source point."""
        problem = self.problem
        directions = problem.target[None, :, None, :] - reference[:, None, :, :]
        along = np.einsum("mnkd,mkd->mnk", directions, moved)
        longest = np.sqrt(np.einsum("mnkd,mnkd->mnk", directions, directions)) * self._lengths
        across = np.sqrt(np.maximum(longest**2 - along**2, 0.0) + 16.0 * _EPS * longest**2)
        cos, sin = np.cos(np.minimum(radii, np.pi))[:, None, None], np.sin(np.minimum(radii, np.pi))[:, None, None]
        furthest = np.where(along >= longest * cos, longest, along * cos + across * sin)
        return _assign(self._fixed - 2.0 * problem.weights * furthest)[0]


def _assign(costs: FloatArray) -> tuple[FloatArray, IntArray]:
    """Solve every assignment (m, n, k): values (m,) and the row of each column (m, k)."""
    num, _, k = costs.shape
    maps = np.empty((num, k), dtype=np.int64)
    for index, cost in enumerate(np.ascontiguousarray(np.swapaxes(costs, 1, 2))):
        maps[index] = linear_sum_assignment(cost)[1]
    values = np.take_along_axis(costs, maps[:, None, :], axis=1)[:, 0, :].sum(axis=1)
    return values, maps
