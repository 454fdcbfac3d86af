"""The bound that PM-SDP's dual variables prove: weak duality, replayed with bounds of every rounding error.

For rotations R with the pattern, write ``[R] = basis @ (1, rho)``. Whatever F_j > 0, u_j and beta <= 0 are, and g_i
(``row_u``) of target points that every map uses, zero for the others,

    E(R, map) >= sum_j alpha_j + sum_i beta_i + sum_j w_j |p_j|^2 - max_R (rho^T (sum F_j) rho + 2 rho^T u),
    alpha_j = min_i  w_j |q_i|^2 + c_ij - beta_i - (v_ij - u_j - g_i)^T F_j^-1 (v_ij - u_j - g_i),
    u = sum_j u_j + sum_i g_i,

because ``-2 w^T rho >= -rho^T F rho - w^T F^-1 w``. The maximum over R is bounded by ``tr L1 + tr L2 + tr Y4 / 4``
where ``sum F_j`` and ``u`` agree with the multipliers L1 of R^T R = I, L2 of R R^T = I, Z of cof R = R and Y4
of conv SO(3) (Y4 >= 0, Y(R) >= 0, tr Y(R) = 1); what is left over costs its norm, since |rho|^2 <= d.

Products with F_j^-1 are never trusted: for any z, ``w^T F^-1 w <= 2 w^T z - z^T F z + |w - F z|^2 / lambda`` where
lambda is a proven lower bound of the smallest eigenvalue of F (Rump, Verification of positive definiteness, 2006).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray
from data_tools.errors import InputError
from pairwise.certificates.certificate import CertificateArrays
from pairwise.problem import Problem, num_left_over

#: Twice the unit roundoff: the extra factor covers the second-order terms of every bound below.
_EPS = float(np.finfo(np.float64).eps)


#: Smallest eigenvalue that an F_j may be proven to have, in the problem's unit: quotients stay within range.
_SMALLEST = 1e-100


def pm_sdp_bound(problem: Problem, given: CertificateArrays) -> float:
    """Return the lower bound that the dual variables of PM-SDP prove.

    Raises
    ------
    InputError
        If an array is missing or of wrong shape, an F_j is not positive definite, a beta is positive, or a target
        point that some map leaves out has a multiplier in ``row_u``.
    """
    n, k, d = problem.num_target, problem.num_source, problem.dim
    special = problem.pattern.special_blocks
    basis = _rotation_basis(problem.pattern.mask, special)
    size = basis.shape[1] - 1
    blocks = [start for start, stop in special if stop - start == 3]
    F, u = given.floats("F", (k, size, size)), given.floats("u", (k, size))
    row_u = given.floats("row_u", (n, size)) if "row_u" in given else np.zeros((n, size))
    beta = given.floats("beta", (n,))
    columns, rows, Z = (
        given.floats(f"{name}_multipliers", (d, d)) for name in ("column", "row", "cross")
    )
    Y4 = given.floats("quaternion_multipliers", (len(blocks), 4, 4))
    if (beta > 0).any():
        raise InputError("certificate: beta must not be positive")
    if not all(np.array_equal(m, np.swapaxes(m, -1, -2)) for m in (F, columns, rows, Y4)):
        raise InputError(
            "certificate: F, the multipliers of R^T R and R R^T and Y4 must be symmetric"
        )
    _check_always_used(problem, np.flatnonzero(row_u.any(axis=1)))
    possible = _possible_matches(problem, given)
    vectors = np.concatenate([u, row_u])
    rotation_part = _rotation_maximum(
        problem.pattern.mask, basis, blocks, F, vectors, (columns, rows, Z, Y4)
    )
    lows = np.where(possible, _cost_lower_bounds(problem, basis, F, u, row_u), np.inf)
    constant = problem.weights * (problem.source**2).sum(axis=1)
    alpha = (lows - beta[:, None]).min(axis=0)
    terms = np.concatenate([alpha, beta, constant, [-rotation_part]])
    error = (
        (len(terms) + d + 8) * _EPS * float(np.abs(terms).sum() + k * np.abs(beta).max(initial=0.0))
    )
    return float(terms.sum()) - error


def _rotation_basis(mask: BoolArray, special_blocks: tuple[tuple[int, int], ...]) -> FloatArray:
    """Return (r, s+1) with ``[R] = basis @ (1, rho)``: entries in column-major order, variables numbered in order.

    Entries in no perfect matching of the mask vanish in every orthogonal matrix; SO(2) is [[c, -s], [s, c]].
    """
    d = len(mask)
    entries = [(s, t) for t in range(d) for s in range(d) if mask[s, t]]
    free = {e for e in entries if mask.all() or _in_perfect_matching(mask, *e)}
    images: dict[tuple[int, int], tuple[int, float]] = {}
    count = 0
    partner: dict[tuple[int, int], tuple[tuple[int, int], float]] = {}
    for a in (a for a, b in special_blocks if b - a == 2):
        partner |= {(a + 1, a + 1): ((a, a), 1.0), (a, a + 1): ((a + 1, a), -1.0)}
    for entry in entries:
        if entry in free and partner.get(entry, (entry, 1.0))[0] not in images:
            count += 1
            images[entry] = (count, 1.0)
        elif entry in free:
            twin, sign = partner[entry]
            images[entry] = (images[twin][0], sign)
    basis = np.zeros((len(entries), count + 1))
    for row, entry in enumerate(entries):
        if entry in images:
            basis[row, images[entry][0]] = images[entry][1]
    return basis


def _in_perfect_matching(mask: BoolArray, row: int, col: int) -> bool:
    minor = np.delete(np.delete(mask, row, axis=0), col, axis=1)
    return num_left_over(minor) == 0


def _rotation_maximum(
    mask: BoolArray,
    basis: FloatArray,
    blocks: list[int],
    F: FloatArray,
    u: FloatArray,
    multipliers: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> float:
    """Bound ``rho^T (sum F_j) rho + 2 rho^T sum u_l`` from above over the rotations."""
    columns, rows, Z, Y4 = multipliers
    d, num = len(mask), max(len(F), len(u))
    t, s = np.nonzero(mask.T)
    same_row, same_col = s[:, None] == s, t[:, None] == t
    form = np.zeros((len(s) + 1, len(s) + 1))
    form[1:, 1:] = same_row * columns[t[:, None], t] + same_col * rows[s[:, None], s]
    position = {(int(a), int(b)): e + 1 for e, (a, b) in enumerate(zip(s, t, strict=True))}
    surplus = 0.0
    for index, b in enumerate(blocks):
        for i, j in np.ndindex(3, 3):
            _add_cofactor(form, position, b, i, j, 0.5 * Z[b + i, b + j])
        form[0, 1:] -= 0.5 * _quaternion_slope(s, t, b, Y4[index])
        lowest = _eigenvalue_floor(Y4[index]) if Y4[index].any() else 0.0
        surplus += (
            0.25 * float(np.trace(Y4[index]))
            + max(0.0, -lowest)
            + 8 * _EPS * float(np.abs(Y4[index]).sum())
        )
    form[1:, 0] = form[0, 1:]
    lift = np.zeros((basis.shape[0] + 1, basis.shape[1]))
    lift[0, 0], lift[1:] = 1.0, basis
    expected = lift.T @ form @ lift
    rest_F = F.sum(axis=0) - expected[1:, 1:]
    rest_u = u.sum(axis=0) - expected[1:, 0]
    error = (num + 2 * d + 12) * _EPS
    size = np.abs(lift).T @ np.abs(form) @ np.abs(lift)
    loose_F = np.abs(rest_F) + error * (np.abs(F).sum(axis=0) + size[1:, 1:])
    loose_u = np.abs(rest_u) + error * (np.abs(u).sum(axis=0) + size[1:, 0])
    left_over = d * float(np.linalg.norm(loose_F)) + 2.0 * np.sqrt(d) * float(
        np.linalg.norm(loose_u)
    )
    traces = float(np.trace(columns) + np.trace(rows))
    constant_part = float(expected[0, 0])
    return (
        traces
        - constant_part
        + surplus
        + left_over * 1.0001
        + error * (np.abs(columns).sum() + np.abs(rows).sum())
    )


def _add_cofactor(
    form: FloatArray, position: dict[tuple[int, int], int], block: int, i: int, j: int, half: float
) -> None:
    """Add ``2 half (cof R - R)_ij`` of a 3x3 block to a symmetric quadratic form in (1, [R])."""
    i1, i2, j1, j2 = (block + (a + o) % 3 for a, o in ((i, 1), (i, 2), (j, 1), (j, 2)))
    pairs = (((i1, j1), (i2, j2), half), ((i1, j2), (i2, j1), -half))
    for first, second, value in pairs:
        if first in position and second in position:
            form[position[first], position[second]] += value
            form[position[second], position[first]] += value
    if (block + i, block + j) in position:
        form[0, position[block + i, block + j]] -= half


def _quaternion_slope(
    s: NDArray[np.int64], t: NDArray[np.int64], block: int, Y4: FloatArray
) -> FloatArray:
    """Return the gradient of <Y4, Y(R)> in [R] for one 3x3 block."""
    y = Y4
    slope = 0.25 * np.array(
        [
            [
                y[0, 0] + y[1, 1] - y[2, 2] - y[3, 3],
                2 * (y[1, 2] - y[0, 3]),
                2 * (y[1, 3] + y[0, 2]),
            ],
            [
                2 * (y[1, 2] + y[0, 3]),
                y[0, 0] - y[1, 1] + y[2, 2] - y[3, 3],
                2 * (y[2, 3] - y[0, 1]),
            ],
            [
                2 * (y[1, 3] - y[0, 2]),
                2 * (y[2, 3] + y[0, 1]),
                y[0, 0] - y[1, 1] - y[2, 2] + y[3, 3],
            ],
        ]
    )
    inside = (s >= block) & (s < block + 3)
    gradient = np.zeros(len(s))
    gradient[inside] = slope[s[inside] - block, t[inside] - block]
    return gradient


def _eigenvalue_floor(matrix: FloatArray) -> float:
    """Return a proven lower bound of the smallest eigenvalue: a Cholesky factorisation that runs through (Rump)."""
    size = len(matrix)
    magnitude = float(np.abs(matrix).sum(axis=1).max()) + 1e-300
    margin = 4.0 * (size + 2) * size * _EPS * magnitude
    floor = float(np.linalg.eigvalsh(matrix)[0])
    for _ in range(60):
        trial = floor - 2.0 * margin if floor < 4.0 * margin else 0.9 * floor - margin
        try:
            np.linalg.cholesky(matrix - (trial + margin) * np.eye(size))
        except np.linalg.LinAlgError:
            margin *= 2.0
            continue
        return trial
    return -np.inf


def _possible_matches(problem: Problem, given: CertificateArrays) -> BoolArray:
    """Return the allowed matches but those listed as impossible, once it is checked that no assignment uses these."""
    candidates, shape = problem.allowed, problem.allowed.shape
    impossible = np.zeros((0, 2), dtype=np.int64)
    if "impossible" in given:
        impossible = np.unique(given.indices("impossible", (None, 2), upper=shape), axis=0)
    possible = candidates.copy()
    for i, j in impossible:
        if _in_perfect_matching(candidates, i, j):
            raise InputError(
                f"certificate: lists the possible match of source point {j} to {i} as impossible"
            )
        possible[i, j] = False
    return possible


def _check_always_used(problem: Problem, target_points: NDArray[np.int64]) -> None:
    """Refuse target points without which a map of all source points is left."""
    for i in target_points:
        if num_left_over(np.delete(problem.allowed, i, axis=0)) == 0:
            raise InputError(f"certificate: row_u has target point {i}, which a map can leave out")


def _cost_lower_bounds(
    problem: Problem, basis: FloatArray, F: FloatArray, u: FloatArray, row_u: FloatArray
) -> FloatArray:
    """Return lower bounds (n, k) of ``w_j |q_i|^2 + c_ij - 2 v_ij0 - w^T F_j^-1 w`` for ``w = v_ij - u_j - g_i``."""
    q, p, weights, constant_cost = (
        problem.target,
        problem.source,
        problem.weights,
        problem.constant_cost,
    )
    cols, rows = np.nonzero(problem.pattern.mask.T)
    squares = (q**2).sum(axis=1)
    d = q.shape[1]
    lows = np.empty((len(q), len(p)))
    for j in range(len(p)):
        v = (weights[j] * q[:, rows] * p[j, cols]) @ basis
        v_size = np.abs(weights[j] * q[:, rows] * p[j, cols]) @ np.abs(basis)
        linear = weights[j] * squares + constant_cost[:, j] - 2.0 * v[:, 0]
        error = (
            (d + 8)
            * _EPS
            * (weights[j] * squares + np.abs(constant_cost[:, j]) + 2.0 * v_size[:, 0])
        )
        floor = _eigenvalue_floor(F[j])
        if not floor >= _SMALLEST:
            raise InputError(f"certificate: F of source point {j} is not positive definite")
        w_error = 8.0 * _EPS * (v_size[:, 1:] + np.abs(u[j]) + np.abs(row_u))
        quad = _quadratic_upper_bounds(F[j], v[:, 1:] - u[j] - row_u, w_error, floor)
        lows[:, j] = linear - quad - error - 4.0 * _EPS * (np.abs(linear) + np.abs(quad))
    return lows


def _quadratic_upper_bounds(
    F: FloatArray, w: FloatArray, w_error: FloatArray, floor: float
) -> FloatArray:
    """Return upper bounds (n,) of ``w^T F^-1 w`` for rows w known up to ``w_error``."""
    z = np.linalg.solve(F, w.T).T
    rest = w - z @ F
    gamma = 2.0 * (len(F) + 4) * _EPS
    rest_error = gamma * (np.abs(w) + np.abs(z) @ np.abs(F)) + w_error
    main = (z * w).sum(axis=1) + (z * rest).sum(axis=1)
    main_error = (np.abs(z) * (w_error + rest_error + gamma * (np.abs(w) + np.abs(rest)))).sum(
        axis=1
    )
    tail = (((np.abs(rest) + rest_error) / np.sqrt(floor)) ** 2).sum(axis=1)
    return main + 1.0001 * (main_error + tail)
