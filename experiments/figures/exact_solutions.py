"""All exact solutions of a problem without noise: the symmetries of a shape, drawn as extreme points.

Maron et al. 2016, theorem 3: where the relaxation's value is zero, its solution set is the convex hull of the exact
solutions, so the minimiser of a random linear energy of R over that set is, with probability one, a single exact
solution; repeated draws find them all.

The linear energy enters with a small factor beside the relaxed energy itself, ``E / sum_j w_j |p_j|^2 + 1e-3 <G, R>``
with |G| = 1, rather than on the face of zero energy: that program has an interior point, stays solvable when the data
carry rounding errors, and its minimiser is within the factor of an extreme point, which rounding then makes exact.
Each pose is verified by the distances of its matched points.

Zero energy also forces ``|p_j| = |q_i|`` and equal invariants wherever X_ij > 0, because R is orthogonal: such
matches alone get variables, which makes the program small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.errors import InputError, OptionsError
from data_tools.threads import one_blas_thread
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.interior_point import solve_dual
from pairwise.problem import Problem, ProblemArguments
from pairwise.results import Candidate, Status

#: Rotations closer than this (largest entry of the difference) are one solution.
SAME_ROTATION = 1e-3
#: Norm of the linear energy of R beside the relaxed energy relative to that of the source.
LINEAR_ENERGY = 1e-3
#: Relative gap that a draw is solved to, and by how much its bound must exceed what exact solutions reach, as a share
#: of the energy of the source, before there is none.
SOLVED_TOL, IMPOSSIBLE_TOL = 1e-6, 1e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactSolutions:
    """Every pose of zero energy that was found, and the symmetries of the target that relate them.

    Attributes
    ----------
    solutions : tuple of Candidate
        Distinct poses, each verified by its own energy; empty where the shapes do not match exactly.
    symmetries : ndarray, shape (s, d, d)
        The orthogonal matrices ``R_i R_0^T`` that take the first solution to the others; the identity comes first.
    is_group : bool
        Whether the symmetries are closed under composition. Always true for k = n, where new products are added.
    num_draws : int
        Random linear energies minimised.
    status : Status
        ``CONVERGED`` if the last ``patience`` draws brought nothing new, ``ITERATION_LIMIT`` if draws ran out before,
        ``FAILED`` if there is no exact solution.
    """

    solutions: tuple[Candidate, ...]
    symmetries: FloatArray
    is_group: bool
    num_draws: int
    status: Status


@one_blas_thread()
def exact_solutions(
    target: ArrayLike,
    source: ArrayLike,
    *,
    tol: float = 1e-6,
    max_draws: int = 200,
    patience: int = 10,
    seed: int = 0,
    **problem_arguments: Unpack[ProblemArguments],
) -> ExactSolutions:
    """Enumerate the exact solutions of a problem without noise (Maron et al. 2016, theorem 3).

    For k = n the solutions are a coset of the target's symmetry group. The directions drawn are uniform, so every
    element of a coset is equally likely, and the products of what was found are found as well: if something were
    still missing, each draw would reveal it with probability at least one half, and ``patience`` fruitless draws
    happen with probability at most ``2 ** -patience``.

    Parameters
    ----------
    target : array_like, shape (n, d)
    source : array_like, shape (k, d)
    tol : float
        Largest distance of matched points, relative to the largest coordinate norm, that counts as zero.
    max_draws, patience : int
        Draws at most, and draws without anything new after which the enumeration ends.
    seed : int
        Of the random linear energies.
    **problem_arguments
        Group, allowed matches, pattern, invariants and weights, as in
        :meth:`pairwise.problem.Problem.from_user`; weights must be positive.

    Returns
    -------
    ExactSolutions

    Raises
    ------
    InputError
        If a weight is zero, or the source spans so few dimensions that exact solutions
        form a continuous family.
    OptionsError
        If a number is out of range.
    """
    problem = Problem.from_user(target, source, **problem_arguments)
    if not 0 < tol < 1 or max_draws < 1 or patience < 1:
        raise OptionsError(
            "exact_solutions: expected 0 < tol < 1, max_draws >= 1 and patience >= 1"
        )
    _check_isolated(problem)
    radius = float(np.sqrt((problem.target**2).sum(axis=1).max(initial=0.0)))
    possible = _equal_norm_matches(problem, tol * radius)
    if not _has_map(possible):
        return _result(problem, [], 0, Status.FAILED)
    draws = _Draws(
        replace(problem, allowed=read_only(possible)), tol * radius, np.random.default_rng(seed)
    )
    found: list[Candidate] = []
    fruitless = count = 0
    while count < max_draws and fruitless < patience and not draws.impossible:
        count += 1
        before = len(found)
        pose = draws.next_pose()
        if pose is not None and _is_new(pose, found):
            found = draws.closure([*found, pose])
        if pose is not None or not found:
            fruitless = 0 if len(found) > before else fruitless + 1
    status = Status.CONVERGED if fruitless >= patience else Status.ITERATION_LIMIT
    return _result(problem, found, count, status if found else Status.FAILED)


def with_linear_energy(data: RelaxationData, direction: FloatArray) -> RelaxationData:
    """Return the relaxation with ``<direction, rho>`` beside its energy, by the B_ij."""
    tilt = direction / (2.0 * len(data.index))
    return replace(data, vectors=np.where(data.valid[..., None], data.vectors - tilt, 0.0))


class _Draws:
    """The relaxation with a small linear energy of R that is drawn anew for every solve.

    ``impossible`` turns true when the minimum exceeds what any exact solution reaches, ``1e-3 |R|_F``.
    """

    def __init__(self, problem: Problem, tol: float, rng: np.random.Generator) -> None:
        self.problem, self.tol, self.rng = problem, tol, rng
        self.impossible = False
        self.data = RelaxationData.from_problem(problem, cross_products=True, row_sums=False)

    def next_pose(self) -> Candidate | None:
        """Minimise one random linear energy and return the pose it ends at, or None if that is no exact solution."""
        scale, lifted = self.data.constant or 1.0, self.data.lifted
        direction = self.rng.standard_normal(lifted.num_variables)
        direction *= LINEAR_ENERGY * scale / np.linalg.norm(direction)
        solution = solve_dual(with_linear_energy(self.data, direction), tol=SOLVED_TOL)
        self.impossible = solution.dual_value > scale * (
            LINEAR_ENERGY * math.sqrt(self.problem.dim) + IMPOSSIBLE_TOL
        )
        entries = lifted.basis @ np.concatenate([[1.0], solution.primal.R])
        return self.verified(self.problem.pattern.project(self.problem.pattern.unpack(entries)))

    def verified(self, rotation: FloatArray) -> Candidate | None:
        """Round a rotation to a map and back; return the pose if all matched points coincide."""
        problem = self.problem
        for _ in range(2):
            point_map = _assign(problem.assignment_costs(rotation))
            rotation = _procrustes_near(problem, point_map, rotation)
        gaps = np.linalg.norm(problem.source @ rotation.T - problem.target[point_map], axis=1)
        outside = np.abs(rotation[~problem.pattern.mask]).max(initial=0.0)
        if gaps.max() > self.tol or outside > SAME_ROTATION:
            return None
        return _candidate(problem, rotation, point_map)

    def closure(self, poses: list[Candidate]) -> list[Candidate]:
        """Add ``R_a R_b^T R_c`` for all solutions while that yields verified new ones (k = n)."""
        if self.problem.num_source < self.problem.num_target:
            return poses
        closed, done = list(poses), 0
        while done < len(closed):
            done = len(closed)
            base = closed[0].R_target_source
            for left in tuple(closed):
                for right in tuple(closed):
                    product = left.R_target_source @ base.T @ right.R_target_source
                    if any(_same(product, other.R_target_source) for other in closed):
                        continue
                    pose = self.verified(product)
                    if pose is not None and _is_new(pose, closed):
                        closed.append(pose)
        return closed


def _check_isolated(problem: Problem) -> None:
    if (problem.weights == 0).any():
        raise InputError(
            "weights: exact solutions need positive weights; leave points of weight zero out"
        )
    for component in problem.pattern.components:
        points = problem.source[:, component]
        rank = int(
            np.linalg.matrix_rank(points, tol=1e-9 * max(float(np.abs(points).max()), 1e-300))
        )
        if rank < len(component) - 1:
            raise InputError(
                f"source: coordinates {component.tolist()} span only {rank} dimensions, so exact solutions come in "
                f"continuous families; at least {len(component) - 1} are needed"
            )


def _equal_norm_matches(problem: Problem, tol: float) -> BoolArray:
    """Return the allowed matches with ``|p_j| = |q_i|`` in every component of R, and equal invariants."""
    possible = problem.allowed & (problem.constant_cost <= problem.weights * tol**2)
    for component in problem.pattern.components:
        of_target = np.linalg.norm(problem.target[:, component], axis=1)
        of_source = np.linalg.norm(problem.source[:, component], axis=1)
        possible &= np.abs(of_target[:, None] - of_source) <= tol
    return possible


def _has_map(possible: BoolArray) -> bool:
    target_index, source_index = linear_sum_assignment(~possible)
    return bool(possible[target_index, source_index].all())


def _procrustes_near(problem: Problem, point_map: IntArray, rotation: FloatArray) -> FloatArray:
    """Return the best R for a map that acts like ``rotation`` on the directions in which the points do not extend.

    Points in a plane leave the sign of its normal open; plain Procrustes would pick one sign for both solutions.
    """
    correlation = problem.target[point_map].T @ (problem.weights[:, None] * problem.source)
    correlation = np.where(_component_mask(problem), correlation, 0.0)
    u, s, vt = np.linalg.svd(correlation)
    null = s <= 1e-9 * s[0]
    left, right = u[:, null] @ u[:, null].T, vt[null].T @ vt[null]
    return problem.pattern.project(correlation + (s[0] or 1.0) * left @ rotation @ right)


def _component_mask(problem: Problem) -> BoolArray:
    mask = np.zeros((problem.dim, problem.dim), dtype=bool)
    for component in problem.pattern.components:
        mask[np.ix_(component, component)] = True
    return mask


def _assign(costs: FloatArray) -> IntArray:
    source_index, target_index = linear_sum_assignment(costs.T)
    return target_index[np.argsort(source_index)]


def _candidate(problem: Problem, rotation: FloatArray, point_map: IntArray) -> Candidate:
    block = problem.pattern.components[0]
    return Candidate(
        R_target_source=read_only(rotation),
        map_target_source=read_only(point_map),
        energy=problem.energy(rotation, point_map),
        reflected=bool(np.linalg.det(rotation[np.ix_(block, block)]) < 0),
        origin="relaxation",
    )


def _same(left: FloatArray, right: FloatArray) -> bool:
    return bool(np.abs(left - right).max() < SAME_ROTATION)


def _is_new(pose: Candidate, found: list[Candidate]) -> bool:
    return not any(_same(pose.R_target_source, other.R_target_source) for other in found)


def _result(
    problem: Problem, found: list[Candidate], num_draws: int, status: Status
) -> ExactSolutions:
    symmetries = np.zeros((len(found), problem.dim, problem.dim))
    for index, pose in enumerate(found):
        symmetries[index] = pose.R_target_source @ found[0].R_target_source.T
    products = np.einsum("aij,bjk->abik", symmetries, symmetries).reshape(
        -1, 1, problem.dim, problem.dim
    )
    distances = np.abs(products - symmetries).max(axis=(2, 3)) if found else np.zeros((0, 1))
    return ExactSolutions(
        solutions=tuple(found),
        symmetries=read_only(symmetries),
        is_group=bool(found) and bool((distances.min(axis=1) < SAME_ROTATION).all()),
        num_draws=num_draws,
        status=status,
    )
