"""Lower bounds of the matching energy over balls of rotations, for many balls at once.

Let a ball be {R : angle(R, R0) <= r} and let t_j be any points (the reference). For every R in it and every map,

    E(R, map) = sum_j w_j |p_j|^2 - 2 sum_j w_j <t_j, R p_j>                                        (rotation part)
                + sum_j [ w_j |q_map(j)|^2 + c - 2 w_j <q_map(j) - t_j, R p_j> ]                     (matching part)

The rotation part has a closed-form bound over the ball; in the matching part each bracket is smallest where R p_j
is the point of the spherical cap of radius r about R0 p_j that is nearest to the direction q_i - t_j, which leaves
an assignment problem. With t = 0 this is the usual bound that moves every point on its own; with t_j the image of
p_j under the best map at R0 it is exact as soon as that map stays best in the whole ball, so that the ball around
the optimum is settled at a positive radius instead of being split for ever. The bound is concave in t, so a few
supergradient steps (Polyak's step length towards the threshold) from a multiple of that reference make the most of
every ball.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import FloatArray, IntArray
from pairwise.problem.problem import Problem
from pairwise.tight.lift import make_lift
from pairwise.tight.problem import energy_scale

#: The first reference: this multiple of the best map's images.
FIRST_REFERENCE = 0.4
#: How often a reference is evaluated and improved before the map's images themselves are tried.
NUM_STEPS = 4
#: Polyak's step towards the threshold is stretched by this, and at most so long.
_STRETCH, _LONGEST = 1.5, 0.5
#: Numbers that may be held at once.
_CHUNK_NUMBERS = 100_000
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
        fixed = problem.weights * (problem.target**2).sum(axis=1)[:, None] + problem.constant_cost
        self._fixed = np.ascontiguousarray(np.where(problem.candidates, fixed, np.inf).T)
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
        costs = self._fixed - 2.0 * problem.weights[:, None] * (moved @ problem.target.T)
        energies, maps = _assign(costs)
        bounds = np.full(len(rotations), -np.inf)
        images = problem.target[maps]
        reference, balls = FIRST_REFERENCE * images, np.arange(len(rotations))
        for step in range(NUM_STEPS + 1):
            if step == NUM_STEPS:
                reference = images[balls]
            rotation_part, turned = self._rotation_part(rotations[balls], radii[balls], reference)
            matching_part, placed = self._matching_part(moved[balls], radii[balls], reference)
            found = rotation_part + matching_part - self._allowance
            bounds[balls] = np.maximum(bounds[balls], found)
            remain = bounds[balls] <= threshold
            balls = balls[remain]
            if not len(balls):
                break
            slope = (2.0 * problem.weights[:, None] * (placed - turned))[remain]
            size = np.maximum((slope**2).sum(axis=(1, 2)), np.finfo(np.float64).tiny)
            length = np.minimum(_STRETCH * (threshold - found[remain]) / size, _LONGEST)
            reference = reference[remain] + length[:, None, None] * slope
        return bounds, energies + self._total, maps

    def _rotation_part(
        self, rotations: FloatArray, radii: FloatArray, reference: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Bound ``sum_j w_j |p_j|^2 - 2 <T, R>`` with T = sum_j w_j t_j p_j^T from below over each ball.

        With R = R0 exp(theta [a]) and G = R0^T T: <T, R> = tr G + sin(theta) g.a - (1 - cos(theta)) (tr G - a^T G
        a), g the axial vector of G; bounding g.a and a^T G a apart leaves one sinusoid in theta. Over all rotations
        the maximum is the largest eigenvalue of the quaternion form, and the smaller of the two bounds counts.

        Returns
        -------
        bounds : ndarray, shape (m,)
        turned : ndarray, shape (m, k, d)
            R p_j at the rotation about g by the angle at which the sinusoid is largest.
        """
        problem = self.problem
        attraction = np.swapaxes(reference, 1, 2) @ (problem.weights[:, None] * problem.source)
        local = np.swapaxes(rotations, 1, 2) @ attraction
        trace = np.trace(local, axis1=1, axis2=2)
        skew = local - np.swapaxes(local, 1, 2)
        slope = np.sqrt(0.5 * (skew**2).sum(axis=(1, 2)))
        bend = trace
        if problem.dim == 3:
            bend = trace - np.linalg.eigvalsh(0.5 * (local + np.swapaxes(local, 1, 2)))[:, -1]
        angle = np.minimum(np.arctan2(slope, bend), radii)
        inside = angle < radii
        at_edge = slope * np.sin(radii) - bend * (1.0 - np.cos(radii))
        nearby = trace + np.where(inside, np.hypot(slope, bend) - bend, at_edge)
        columns = np.swapaxes(attraction, 1, 2).reshape(len(attraction), -1)
        anywhere = np.linalg.eigvalsh(np.tensordot(columns, self._spin, axes=1))[:, -1]

        axis = skew / np.maximum(slope, np.finfo(np.float64).tiny)[:, None, None]
        sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
        turn = np.eye(problem.dim) + sin * axis + (1.0 - cos) * (axis @ axis)
        turned = problem.source @ np.swapaxes(rotations @ turn, 1, 2)
        return self._total - 2.0 * np.minimum(nearby, anywhere), turned

    def _matching_part(
        self, moved: FloatArray, radii: FloatArray, reference: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the assignment of the brackets, each at its smallest over the cap of its source point.

        Returns
        -------
        values : ndarray, shape (m,)
        placed : ndarray, shape (m, k, d)
            Where on its cap the assignment puts every point.
        """
        problem = self.problem
        along = np.zeros((*moved.shape[:2], problem.num_target))
        squares = np.zeros_like(along)
        for axis in range(problem.dim):
            direction = problem.target[:, axis] - reference[:, :, axis, None]
            squares += direction**2
            direction *= moved[:, :, axis, None]
            along += direction
        squares *= (self._lengths**2)[:, None]
        radii = np.minimum(radii, np.pi)[:, None, None]
        across = np.sqrt(np.maximum(squares - along**2, 0.0) + 16.0 * _EPS * squares)
        lengths = np.sqrt(squares)
        within = along >= lengths * np.cos(radii)
        furthest = np.where(within, lengths, along * np.cos(radii) + across * np.sin(radii))
        furthest *= -2.0 * problem.weights[:, None]
        furthest += self._fixed
        values, maps = _assign(furthest)
        chosen = problem.target[maps] - reference
        towards = _directions(chosen) * self._lengths[:, None]
        return values, _onto_caps(towards, moved, radii)


def _onto_caps(towards: FloatArray, centres: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the points of spherical caps nearest to given points of the same spheres, shape (m, k, d)."""
    squares = np.maximum((centres**2).sum(axis=2, keepdims=True), np.finfo(np.float64).tiny)
    cosine = (towards * centres).sum(axis=2, keepdims=True) / squares
    aside = towards - cosine * centres
    aside = _directions(aside) * np.sqrt(squares)
    return np.where(cosine >= np.cos(radii), towards, np.cos(radii) * centres + np.sin(radii) * aside)


def _directions(vectors: FloatArray) -> FloatArray:
    """Return unit vectors (m, k, d), zero where a vector vanishes."""
    lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)


def _assign(costs: FloatArray) -> tuple[FloatArray, IntArray]:
    """Solve every assignment (m, k, n) of source to target points: values (m,) and maps (m, k)."""
    maps = np.empty(costs.shape[:2], dtype=np.int64)
    for index, cost in enumerate(costs):
        maps[index] = linear_sum_assignment(cost)[1]
    return np.take_along_axis(costs, maps[:, :, None], axis=2)[:, :, 0].sum(axis=1), maps
