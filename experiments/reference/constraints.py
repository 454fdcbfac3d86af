"""Linear equations and cones on the lifted rotation (C, [R]), written entry by entry for the reference solvers.

C stands for E[[R][R]^T] and [R] for the free entries of R in column-major order, so every quadratic identity of the
rotations is one linear equation in (C, [R]) (Maron et al. 2016, section 4.1). The equations are derived here from the
identities themselves, independently of the dual solver, because they are what that solver is tested against.

SCS and Clarabel solve them, called through CVXPY.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any, TypeAlias

import cvxpy as cp
import numpy as np
from scipy.sparse import coo_array, csr_array

from data_tools.arrays import FloatArray, IntArray
from data_tools.checks import check_choice
from pairwise.relaxations import check_limits
from pairwise.results import Status
from pairwise.rotation_pattern import RotationPattern

#: Iterations after which each solver gives up unless told otherwise.
DEFAULT_MAX_ITERATIONS = {"scs": 100_000, "clarabel": 200}


def solve_program(
    program: Any,
    *,
    solver: str,
    tol: float,
    max_iterations: int | None = None,
    time_limit_s: float | None = None,
) -> Status:
    """Run one of the two solvers on a CVXPY problem and say how it ended; the values stay in the problem."""
    settings = _solver_settings(solver, tol, max_iterations, time_limit_s)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings(
                "ignore", message="Solution may be inaccurate"
            )  # the status says so
            program.solve(solver=solver.upper(), **settings)
    except cp.error.SolverError:
        return Status.FAILED
    except (
        BaseException
    ) as error:  # Clarabel panics on some ill-posed programs, outside the Exception hierarchy
        if type(error).__name__ != "PanicException":
            raise
        return Status.FAILED
    if program.status == cp.OPTIMAL:
        return Status.CONVERGED
    if program.status not in (cp.OPTIMAL_INACCURATE, cp.USER_LIMIT):
        return Status.FAILED
    stats = program.solver_stats
    if time_limit_s is not None and (stats.solve_time or 0.0) >= 0.9 * time_limit_s:
        return Status.TIME_LIMIT
    limit = max_iterations or DEFAULT_MAX_ITERATIONS[solver]
    return Status.ITERATION_LIMIT if (stats.num_iters or 0) >= limit else Status.STALLED


def _solver_settings(
    solver: str, tol: float, max_iterations: int | None, time_limit_s: float | None
) -> dict[str, float]:
    check_choice("solver", solver, DEFAULT_MAX_ITERATIONS)
    limit = DEFAULT_MAX_ITERATIONS[solver] if max_iterations is None else max_iterations
    check_limits(tol, limit, time_limit_s)
    if solver == "scs":
        settings = {"eps_abs": tol, "eps_rel": tol, "max_iters": limit}
        return settings if time_limit_s is None else {**settings, "time_limit_secs": time_limit_s}
    settings = {"tol_gap_abs": tol, "tol_gap_rel": tol, "tol_feas": tol, "max_iter": limit}
    return settings if time_limit_s is None else {**settings, "time_limit": time_limit_s}


#: A polynomial in R of degree two: (coefficient, entry, entry or None for a linear term).
Entry = tuple[int, int]
Polynomial = list[tuple[float, Entry, Entry | None]]


#: Equations ``quadratic @ vec(C) + linear @ [R] = constant``, without those that vanish identically: sparse
#: (m, r * r) and (m, r), and (m,). C is symmetric, so its vectorisation order does not matter.
LiftedEquations: TypeAlias = tuple[csr_array, csr_array, FloatArray]


def orthogonality_equations(pattern: RotationPattern) -> LiftedEquations:
    """Return ``R R^T = I`` and ``R^T R = I`` as equations in C (Maron et al. 2016, eq. 8).

    Both have the same trace on every connected component of the pattern, so one diagonal equation each is left out.
    """
    d = pattern.dim
    redundant = {int(index[0]) for index in pattern.components}
    polynomials: list[tuple[Polynomial, float]] = []
    for a in range(d):
        for b in range(a, d):
            constant = float(a == b)
            polynomials.append(([(1.0, (a, t), (b, t)) for t in range(d)], constant))
            if a != b or a not in redundant:
                polynomials.append(([(1.0, (t, a), (t, b)) for t in range(d)], constant))
    return _collect(pattern, polynomials)


def cross_product_equations(pattern: RotationPattern) -> LiftedEquations:
    """Return ``cof R = R`` for each rotation block of size 3 as equations in (C, [R]).

    The cofactor of entry (a, b) is ``R_{a+1,b+1} R_{a+2,b+2} - R_{a+1,b+2} R_{a+2,b+1}`` with cyclic indices. The
    nine equations say that each row (and each column) is the cross product of the two others.
    """
    polynomials: list[tuple[Polynomial, float]] = []
    for start, stop in pattern.special_blocks:
        if stop - start != 3:
            continue
        for a in range(3):
            for b in range(3):
                rows = [start + (a + s) % 3 for s in range(3)]
                cols = [start + (b + s) % 3 for s in range(3)]
                terms: Polynomial = [
                    (1.0, (rows[1], cols[1]), (rows[2], cols[2])),
                    (-1.0, (rows[1], cols[2]), (rows[2], cols[1])),
                    (-1.0, (rows[0], cols[0]), None),
                ]
                polynomials.append((terms, 0.0))
    return _collect(pattern, polynomials)


def hull_constraints(pattern: RotationPattern, entries: Any) -> list[Any]:
    """Return the CVXPY constraints that put each rotation block of R in the convex hull of the rotations.

    Size 3 is the 4 x 4 linear matrix inequality of Saunderson, Parrilo and Willsky (2015) in the quaternion moment
    matrix Y; size 2 is ``[[a, -b], [b, a]]`` (the disc follows from orthogonality of the lifted R). Larger blocks
    have no small description and get none, which keeps bounds valid.

    Parameters
    ----------
    pattern : RotationPattern
    entries : cvxpy expression, shape (r,)
        [R].
    """
    position = _positions(pattern)

    def entry(a: int, b: int) -> Any:
        return entries[position[a, b]] if position[a, b] >= 0 else 0.0

    constraints: list[Any] = []
    for start, stop in pattern.special_blocks:
        block = [[entry(a, b) for b in range(start, stop)] for a in range(start, stop)]
        if stop - start == 2:
            constraints += _equal(block[0][0], block[1][1]) + _equal(block[0][1], -block[1][0])
        elif stop - start == 3:
            rows = quaternion_moments(block)
            constraints.append(
                cp.bmat([[cp.reshape(y, (1, 1), order="F") for y in row] for row in rows]) >> 0
            )
    return constraints


def _equal(left: Any, right: Any) -> list[Any]:
    """Return ``left = right`` as a CVXPY constraint, or none where both are the constant zero."""
    return [] if isinstance(left, float) and isinstance(right, float) else [left == right]


def quaternion_moments(block: Any) -> list[list[Any]]:
    """Return the rows of 4 Y(R), linear in the entries of a 3 x 3 block of numbers or of CVXPY expressions.

    For a rotation of unit quaternion q, Y is ``q q^T``; R is in the convex hull of SO(3) if and only if Y is PSD.
    """
    (r11, r12, r13), (r21, r22, r23), (r31, r32, r33) = block
    y01, y02, y03 = r32 - r23, r13 - r31, r21 - r12
    y12, y13, y23 = r12 + r21, r13 + r31, r23 + r32
    return [
        [1.0 + r11 + r22 + r33, y01, y02, y03],
        [y01, 1.0 + r11 - r22 - r33, y12, y13],
        [y02, y12, 1.0 - r11 + r22 - r33, y23],
        [y03, y13, y23, 1.0 - r11 - r22 + r33],
    ]


def _positions(pattern: RotationPattern) -> IntArray:
    """Return the index in [R] of every entry of R, -1 where it is zero, shape (d, d)."""
    positions = np.full((pattern.dim, pattern.dim), -1, dtype=np.int64)
    positions[pattern.entries] = np.arange(pattern.num_entries)
    return positions


def _collect(
    pattern: RotationPattern, polynomials: Iterable[tuple[Polynomial, float]]
) -> LiftedEquations:
    """Turn polynomials in R, each with its constant, into equations; drop those without any free entry."""
    position, r = _positions(pattern), pattern.num_entries
    quadratic: list[tuple[int, int, float]] = []
    linear: list[tuple[int, int, float]] = []
    constants: list[float] = []
    for terms, constant in polynomials:
        row, found = len(constants), False
        for coefficient, first, second in terms:
            s = position[first]
            t = s if second is None else position[second]
            if s < 0 or t < 0:
                continue
            found = True
            if second is None:
                linear.append((row, int(s), coefficient))
            else:
                quadratic.append((row, int(s * r + t), coefficient))
        if found:
            constants.append(constant)
    num = len(constants)
    return _sparse(quadratic, (num, r * r)), _sparse(linear, (num, r)), np.array(constants)


def _sparse(entries: list[tuple[int, int, float]], shape: tuple[int, int]) -> csr_array:
    rows, cols, values = zip(*entries, strict=True) if entries else ((), (), ())
    return coo_array(
        (np.array(values, float), (np.array(rows, int), np.array(cols, int))), shape=shape
    ).tocsr()
