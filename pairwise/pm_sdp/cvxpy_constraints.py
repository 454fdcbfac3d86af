"""Linear equations and cones on the lifted rotation (C, [R]), written entry by entry for CVXPY.

C stands for E[[R][R]^T] and [R] for the free entries of R in column-major order, so every quadratic identity of the
rotations is one linear equation in (C, [R]) (Maron et al. 2016, section 4.1). The equations are derived here from the
identities themselves, independently of :mod:`pairwise.pm_sdp.lifted_rotation`, whose solver is tested against them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import cvxpy as cp
import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_array, csr_array

from data_tools.arrays import FloatArray, IntArray
from pairwise.rotation_pattern import RotationPattern

#: Relative size below which a pivot of the equations counts as zero.
_RANK_TOL = 1e-10

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


def independent_equations(
    equations: Iterable[LiftedEquations], basis: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Write equations in the variables rho of ``[R] = basis @ rho``, and drop those that depend on the others.

    Parameters
    ----------
    equations : iterable of LiftedEquations
    basis : ndarray, shape (r, s)

    Returns
    -------
    quadratic, linear, constants : ndarray, shapes (e, s * s), (e, s) and (e,)
        ``quadratic @ vec(E[rho rho^T]) + linear @ E[rho] = constants``.
    """
    r, s = basis.shape
    quadratic, linear, constants = (
        np.concatenate(parts)
        for parts in zip(
            *((q.toarray(), lin @ basis, constant) for q, lin, constant in equations), strict=True
        )
    )
    forms = basis.T @ quadratic.reshape(-1, r, r) @ basis
    forms = 0.5 * (forms + np.swapaxes(forms, 1, 2))
    rows = np.concatenate([forms.reshape(-1, s * s), linear, constants[:, None]], axis=1)
    _, triangle, order = qr(rows.T, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(triangle))
    kept = np.sort(order[: len(pivots)][pivots > _RANK_TOL * pivots[0]])
    return rows[kept, : s * s], rows[kept, s * s : -1], rows[kept, -1]


def hull_constraints(pattern: RotationPattern, entries: Any) -> list[Any]:
    """Return the CVXPY constraints that put each 3 x 3 rotation block of R in the convex hull of the rotations.

    Each is the linear matrix inequality of Saunderson, Parrilo and Willsky (2015) in the quaternion moment matrix.
    Blocks of size 2 need none: orthogonality of the lifted R says it. Larger blocks have no small description and
    get none, which keeps bounds valid.

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
        if stop - start == 3:
            block = [[entry(a, b) for b in range(start, stop)] for a in range(start, stop)]
            rows = [
                [cp.reshape(y, (1, 1), order="F") for y in row] for row in quaternion_moments(block)
            ]
            constraints.append(cp.bmat(rows) >> 0)
    return constraints


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
