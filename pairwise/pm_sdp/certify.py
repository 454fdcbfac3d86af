"""From the last dual iterate to a certificate: exact linear constraints, optimal potentials, a verified bound."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from data_tools.arrays import BoolArray, FloatArray, read_only
from data_tools.errors import InputError
from pairwise.certificates.certificate import Certificate, hash_problem, problem_arrays
from pairwise.certificates.verify import proven_bound
from pairwise.pm_sdp.data import RelaxationData, match_costs
from pairwise.pm_sdp.lifted_rotation import LiftedRotation
from pairwise.problem import Problem

#: Times that F may be shifted away from singularity, each time ten times further.
_MAX_SHIFTS = 18


def certify_dual(
    problem: Problem,
    data: RelaxationData,
    *,
    F: FloatArray,
    u: FloatArray,
    g: FloatArray,
    y: FloatArray,
    Y: FloatArray,
) -> Certificate:
    """Turn a dual point into a certificate whose bound the verifier confirms.

    The point's linear constraints are closed exactly, F is shifted until it is safely positive definite (a shift t
    costs t d), and the potentials are those of the assignment problem at the point's costs.

    Parameters
    ----------
    problem : Problem
    data : RelaxationData
        Of this problem.
    F, u, g, Y : ndarray, shapes (k, s, s), (k, s), (n, s) and (q, 4, 4)
        See :class:`pairwise.pm_sdp.variables.DualPoint`.
    y : ndarray, shape (e,)
        Multipliers of the moment equations.
    """
    lifted, Y = data.lifted, _symmetrised(Y)
    F, u = _close_constraints(lifted, _symmetrised(F), u, g, y, Y)
    arrays = problem_arrays(problem)
    arrays |= _multiplier_arrays(lifted, y, Y)
    arrays["u"] = u
    if data.tied.any():
        arrays["row_u"] = g
    arrays["impossible"] = np.argwhere(problem.allowed & ~_support(data))
    arrays, bound = _with_safe_bound(problem, data, arrays, F)
    frozen = {name: read_only(np.array(values)) for name, values in arrays.items()}
    return Certificate(
        kind="pm-sdp", arrays=frozen, problem_hash=hash_problem(problem), bound=bound
    )


def _symmetrised(matrices: FloatArray) -> FloatArray:
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))


def _support(data: RelaxationData) -> BoolArray:
    """Return the allowed matches (n, k) that some assignment uses."""
    return data.scatter(data.valid.astype(np.float64)) > 0.0


def _close_constraints(
    lifted: LiftedRotation,
    F: FloatArray,
    u: FloatArray,
    g: FloatArray,
    y: FloatArray,
    quaternions: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Spread what the sums of F, and of u and g, miss over F and u of the source points."""
    expected = np.tensordot(y, lifted.equations, 1)
    mean = expected[0, 1:].copy()
    for slopes, Y in zip(lifted.quaternion_slopes, quaternions, strict=True):
        mean -= 0.5 * np.tensordot(slopes, Y, 2)
    mean -= u.sum(axis=0) + g.sum(axis=0)
    return F + _symmetrised(expected[1:, 1:] - F.sum(axis=0)) / len(F), u + mean / len(u)


def _multiplier_arrays(
    lifted: LiftedRotation, y: FloatArray, quaternions: FloatArray
) -> dict[str, NDArray[Any]]:
    """Return L1, L2, Z and Y4 from the multipliers of the equations."""
    dim = lifted.pattern.dim
    named = {
        "columns": np.zeros((dim, dim)),
        "rows": np.zeros((dim, dim)),
        "cross": np.zeros((dim, dim)),
    }
    for value, (kind, s, t) in zip(y, lifted.labels, strict=True):
        if kind == "cross":
            named[kind][s, t] = value
        else:
            named[kind][s, t] += 0.5 * value
            named[kind][t, s] += 0.5 * value
    num_blocks = sum(stop - start == 3 for start, stop in lifted.pattern.special_blocks)
    return {
        "column_multipliers": named["columns"],
        "row_multipliers": named["rows"],
        "cross_multipliers": named["cross"],
        "quaternion_multipliers": quaternions if len(quaternions) else np.zeros((num_blocks, 4, 4)),
    }


def _with_safe_bound(
    problem: Problem, data: RelaxationData, arrays: dict[str, NDArray[Any]], F: FloatArray
) -> tuple[dict[str, NDArray[Any]], float]:
    """Shift F by multiples of the identity until the verifier accepts it; return all arrays and the bound."""
    k = len(F)
    counts = np.diag((data.lifted.basis[:, 1:] ** 2).sum(axis=0))
    shift, columns = 0.0, arrays["column_multipliers"]
    scale = float(np.abs(F).max(initial=0.0)) or 1.0
    for attempt in range(_MAX_SHIFTS):
        arrays["F"] = F + shift * counts
        arrays["column_multipliers"] = columns + k * shift * np.eye(len(columns))
        try:
            arrays["beta"] = _potentials(problem, data, arrays)
            return arrays, proven_bound(problem, "pm-sdp", arrays)
        except (InputError, np.linalg.LinAlgError):
            shift = scale * 10.0 ** (attempt - 14)
    raise ArithmeticError("the dual point cannot be made positive definite")


def _potentials(
    problem: Problem, data: RelaxationData, arrays: dict[str, NDArray[Any]]
) -> FloatArray:
    """Return the non-positive row potentials of the assignment problem at the costs c(F, u), by shortest paths."""
    costs, vectors = match_costs(problem, data.lifted)
    inverse_factor = np.linalg.inv(np.linalg.cholesky(arrays["F"]))
    w = np.swapaxes(vectors, 0, 1) - arrays["u"][:, None, :] - arrays.get("row_u", 0.0)
    costs -= ((w @ np.swapaxes(inverse_factor, 1, 2)) ** 2).sum(axis=2).T
    costs = np.where(_support(data), costs, np.inf)
    n, k = costs.shape
    taken, columns = scipy.optimize.linear_sum_assignment(costs)
    rows = np.empty(k, dtype=np.int64)
    rows[columns] = taken
    extra = costs - costs[rows, np.arange(k)]
    beta = np.zeros(n)
    for _ in range(n):
        shorter = np.minimum(beta, (extra + beta[rows]).min(axis=1))
        if np.array_equal(shorter, beta):
            break
        beta = shorter
    return beta
