"""Checks certificates of the tight and quaternion relaxations without the solver: weak duality, with rounding.

For every rotation R with lifted vector z, ``Z = z z^T``, ``tr Z = tau``, and every injective map,

    E = sum_j <S_map(j)j, Z> + <sum_j A_j + sum_i B_i, Z> + sum_(i unmatched) <S_i0, Z>,
    S_ij = W_ij - A_j - B_i + N_ij,   S_i0 = N_i0 - B_i,   <N, Z> = 0 as N is a combination of identities of z,

and <S, Z> is at least tau times the smallest eigenvalue of S. What is below an assignment of these bounds, for the
whole problem or forced through one match, is therefore proven. Eigenvalues are lowered by the backward error of the
symmetric eigensolver and by the rounding of S itself (Weyl), assignments by that of their sums.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import BoolArray, FloatArray
from data_tools.errors import InputError
from pairwise.certificates.arrays import CertificateArrays
from pairwise.problem.problem import Problem

_EPS = float(np.finfo(np.float64).eps)
#: Allowances are multiples of eps, the size of the matrix and the norms of what was added up.
_SAFETY = 16.0


def tight_bound(problem: Problem, given: CertificateArrays) -> float:
    """Return the lower bound that the stages of a certificate of kind "tight" or "quaternion" prove.

    Raises
    ------
    InputError
        If stages are missing, malformed, or speak about other matches than those before them leave.
    """
    dim, blocks = problem.dim, problem.pattern.special_blocks
    if dim not in (2, 3) or not problem.pattern.mask.all() or blocks not in ((), ((0, dim),)):
        raise InputError("certificate: this kind is for full rotations in dimension 2 and 3")
    if problem.max_unmatched:
        raise InputError("certificate: this kind is not for partial matching")
    bound = _chirality_bound(problem, given, "proper")
    if not blocks:
        mirror = -np.ones(3) if dim == 3 else np.array([1.0, -1.0])
        bound = min(bound, _chirality_bound(replace(problem, source=problem.source * mirror), given, "reflected"))
    return max(bound, 0.0) if (problem.constant_cost >= 0).all() else bound


def _chirality_bound(problem: Problem, given: CertificateArrays, chirality: str) -> float:
    """Follow the stages: each proves what the matches dropped after it cost at least, the last bounds the rest."""
    remaining = problem.allowed
    costs, base = np.zeros(remaining.shape), 0.0
    number, floor, bound = 0, np.inf, -np.inf
    while f"{chirality}_{number}_allowed" in given:
        allowed = given.bools(f"{chirality}_{number}_allowed", remaining.shape)
        if (allowed & ~remaining).any() or not allowed.any(axis=0).all():
            raise InputError(f"certificate: stage {number} ({chirality}) speaks about other matches than those left")
        if (number == 0) != np.array_equal(allowed, remaining):
            raise InputError(f"certificate: stage {number} ({chirality}) must drop matches, the first stage none")
        if number:
            floor = min(floor, _forced_floor(costs, base, remaining & ~allowed))
        remaining = allowed
        costs, base = _stage_costs(problem, given, f"{chirality}_{number}_", allowed)
        assignment = _assignment_floor(costs)
        bound = _sum_floor(assignment, base) if np.isfinite(assignment) else np.inf
        number += 1
    if not number:
        raise InputError(f"certificate: has no proof for the {chirality} rotations")
    return min(bound, floor)


def _sum_floor(*terms: float) -> float:
    """Return a number that is at most the exact sum of finite terms."""
    return float(np.sum(terms) - 2.0 * len(terms) * _EPS * np.abs(terms).sum())


def _stage_costs(
    problem: Problem, given: CertificateArrays, prefix: str, allowed: BoolArray
) -> tuple[FloatArray, float]:
    """Return costs (n, k), ``inf`` where not allowed, and a constant: E is at least their assignment plus it."""
    (n, k), dim, q, p = allowed.shape, problem.dim, problem.target, problem.source
    B = given.floats(prefix + "target_multipliers", (n, None, None))
    size = B.shape[1]
    if size not in ((10, 4) if dim == 3 else (3, 2)):
        raise InputError(f"certificate: {prefix}target_multipliers has the unknown size {size}")
    if B.shape[2] != size:
        raise InputError(f"certificate: {prefix}target_multipliers is not made of square matrices")
    entries, identities, trace = _lift(dim, size)
    A = given.floats(prefix + "source_multipliers", (k, size, size))
    rows, cols = np.nonzero(allowed)
    num_free = n if k < n else 0
    nu = given.floats(prefix + "identity_multipliers", (len(rows) + num_free, len(identities)))

    weights, fixed = problem.weights[cols], problem.constant_cost[rows, cols]
    squares = weights * ((q[rows] ** 2).sum(axis=1) + (p[cols] ** 2).sum(axis=1))
    slopes = (q[rows][:, :, None] * (-2.0 * weights[:, None] * p[cols])[:, None, :]).reshape(len(rows), -1)
    functionals = _without(np.concatenate([entries, np.eye(size)[None] / trace]), identities)
    W = np.tensordot(np.column_stack([slopes, squares + fixed]), functionals, axes=1)
    zero = np.zeros((num_free, size, size))
    parts = (
        np.concatenate([W, zero]),
        -np.concatenate([A[cols], zero]),
        -np.concatenate([B[rows], B[:num_free]]),
        np.tensordot(nu, identities, axes=1),
    )
    slack = parts[0] + parts[1] + parts[2] + parts[3]
    norms = np.linalg.norm(np.stack(parts), axis=(2, 3)).sum(axis=0) + 3.0 * np.abs(nu).sum(axis=1)
    norms[: len(rows)] += squares + np.abs(fixed) + np.abs(slopes).sum(axis=1)
    lowest = np.linalg.eigvalsh(0.5 * (slack + np.swapaxes(slack, 1, 2)))[:, 0]
    smallest = trace * (lowest - _SAFETY * size * _EPS * norms)
    costs = np.full((n, k), np.inf)
    costs[rows, cols] = smallest[: len(rows)]
    if num_free:
        costs -= smallest[len(rows) :, None]
    base = _sum_floor(*smallest[len(rows) :], _constant_floor(A, B, identities, trace))
    if not (np.isfinite(smallest).all() and np.isfinite(base)):
        raise InputError(f"certificate: {prefix} proves nothing, its numbers are out of range")
    return costs, base


def _without(matrices: FloatArray, identities: FloatArray) -> FloatArray:
    """Return the matrices less their part in the span of the identities: the same functionals of Z."""
    flat, known = matrices.reshape(len(matrices), -1), identities.reshape(-1, matrices[0].size)
    return (flat - flat @ np.linalg.pinv(known) @ known).reshape(matrices.shape)


def _constant_floor(A: FloatArray, B: FloatArray, identities: FloatArray, trace: float) -> float:
    """Bound ``<sum A + sum B, Z>`` from below: a multiple of the constant, identities, and a small rest."""
    size = A.shape[1]
    total = A.sum(axis=0) + B.sum(axis=0)
    known = np.concatenate([np.eye(size)[None] / trace, identities]).reshape(-1, size * size)
    coefficients = np.linalg.lstsq(known.T, total.ravel(), rcond=None)[0]
    rest = total - (coefficients @ known).reshape(size, size)
    sizes = float(np.abs(A).sum() + np.abs(B).sum() + 3.0 * np.abs(coefficients).sum())
    lowest = float(np.linalg.eigvalsh(0.5 * (rest + rest.T))[0])
    return float(coefficients[0]) + trace * (lowest - _SAFETY * _EPS * (len(A) + len(B) + size) * sizes)


def _assignment_floor(costs: FloatArray) -> float:
    """Return a lower bound of all assignments of the columns to rows, ``inf`` where there is none.

    The assignment found is not trusted: whatever the row potentials beta <= 0 are, every assignment costs at least
    ``sum_j min_i (c_ij - beta_i) + sum_i beta_i``, and this is it for the ones that belong to the assignment found.
    """
    if not costs.size:
        return 0.0
    try:
        rows, cols = linear_sum_assignment(costs)
    except ValueError:  # infeasible: the costs are finite or inf
        return np.inf
    row_of = np.empty(costs.shape[1], dtype=np.int64)
    row_of[cols] = rows
    extra = costs - costs[row_of, np.arange(costs.shape[1])]
    beta = np.zeros(len(costs))
    for _ in range(len(costs)):
        shorter = np.minimum(beta, (extra + beta[row_of]).min(axis=1))
        if np.array_equal(shorter, beta):
            break
        beta = shorter
    alpha = (costs - beta[:, None]).min(axis=0)
    terms = np.concatenate([alpha, beta])
    return float(terms.sum()) - (len(terms) + 2) * _EPS * float(np.abs(terms).sum())


def _forced_floor(costs: FloatArray, base: float, dropped: BoolArray) -> float:
    """Return a lower bound of base plus any assignment that uses at least one of the dropped matches."""
    floor = np.inf
    for row, col in np.argwhere(dropped):
        rest = _assignment_floor(np.delete(np.delete(costs, row, axis=0), col, axis=1))
        if np.isfinite(rest):
            floor = min(floor, _sum_floor(base, float(costs[row, col]), rest))
    return floor


def _lift(dim: int, size: int) -> tuple[FloatArray, FloatArray, float]:
    """Return matrices of the entries of R (row by row), the identities and ``tr Z`` for a lifted vector's size."""
    if size == 2:
        c, s = np.array([[1.0, 0.0], [0.0, -1.0]]), np.array([[0.0, 1.0], [1.0, 0.0]])
        return np.array([c, -s, s, c]), np.zeros((0, 2, 2)), 1.0
    if size == 3:
        c, s = np.zeros((3, 3)), np.zeros((3, 3))
        c[0, 1] = c[1, 0] = s[0, 2] = s[2, 0] = 0.5
        return np.array([c, -s, s, c]), np.diag([1.0, -1.0, -1.0])[None], 2.0
    if size == 4:
        units = np.eye(4)
        products = np.array([[_conjugate(units[a], units[b]) for b in range(4)] for a in range(4)])
        forms = 0.5 * (products + products.transpose(1, 0, 2, 3))
        return forms.transpose(2, 3, 0, 1).reshape(9, 4, 4), np.zeros((0, 4, 4)), 1.0
    entries = np.zeros((3, 3, 10, 10))
    for row in range(3):
        for col in range(3):
            position = 1 + 3 * col + row
            entries[row, col, 0, position] = entries[row, col, position, 0] = 0.5
    return entries.reshape(9, 10, 10), _quadratic_identities(), 4.0


def _conjugate(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the matrix of ``v -> b v conj(a)`` on pure quaternions; for a = b of norm one it is their rotation."""
    a_cross, b_cross = _cross(a[1:]), _cross(b[1:])
    return a[0] * b[0] * np.eye(3) + np.outer(a[1:], b[1:]) + a[0] * b_cross + b[0] * a_cross + a_cross @ b_cross


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _quadratic_identities() -> FloatArray:
    """Return the matrices of the identities on z = (1, vec R), by polarisation of the forms that vanish."""
    units = np.eye(10)
    single = np.array([_vanishing_forms(u) for u in units])
    pairs = np.array([[_vanishing_forms(u + v) for v in units] for u in units])
    return np.moveaxis(0.5 * (pairs - single[:, None] - single[None, :]), -1, 0)


def _vanishing_forms(z: FloatArray) -> FloatArray:
    """Return R R^T - z0^2 I, R^T R - z0^2 I without its last entry, and cof(R) - z0 R, as one vector of 20 values."""
    rotation, upper = z[1:].reshape(3, 3).T, np.triu_indices(3)
    square = z[0] ** 2 * np.eye(3)
    columns = [np.cross(rotation[:, (c + 1) % 3], rotation[:, (c + 2) % 3]) - z[0] * rotation[:, c] for c in range(3)]
    by_rows, by_columns = rotation @ rotation.T - square, rotation.T @ rotation - square
    return np.concatenate([by_rows[upper], by_columns[upper][:-1], *columns])
