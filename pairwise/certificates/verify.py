"""Checks certificates without the solvers: is it for this problem, and does it prove what it claims.

The bound of all arrangements of a collection is checked here as well, without the search that found it. For one pose
R_i per shape the energy is the sum over pairs of F_ij(R_i^T R_j). For any matrices L_ij (*tilts*) and any symmetric
Y_i, with S the matrix that has L_ij / 2 beside the diagonal and Y_i on it,

    sum_ij F_ij(R_i^T R_j)  =  sum_ij [F_ij - <L_ij, .>](R_i^T R_j)  +  tr X^T S X  -  tr Y,    X the stack of R_i^T,

because X_i X_j^T = R_i^T R_j. The first terms are at least their minima over all rotations, and tr X^T S X is at
least dN min(0, least eigenvalue of S). A minimum of F - <L, .> is bounded cell by cell as that of F is
(:mod:`pairwise.certificates.verify_cells`). Whatever the numbers are, what is returned holds.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread
from pairwise.certificates.certificate import (
    PROBLEM_ARRAYS,
    Certificate,
    CertificateArrays,
    cost_deviation,
    in_unit,
    read_problem,
)
from pairwise.certificates.verify_cells import cells_bound
from pairwise.certificates.verify_pm_sdp import pm_sdp_bound
from pairwise.problem import Problem

_EPS = float(np.finfo(np.float64).eps)


def gram_matrix(edges: IntArray, tilts: FloatArray, diagonal: FloatArray) -> FloatArray:
    """Return S, shape (3N, 3N), of tilts (E, 3, 3) of distinct pairs (E, 2) and blocks Y (N, 3, 3)."""
    num, (left, right) = len(diagonal), edges.T
    matrix, every = np.zeros((num, 3, num, 3)), np.arange(num)
    matrix[left, :, right] = 0.5 * tilts
    matrix[right, :, left] = 0.5 * np.swapaxes(tilts, 1, 2)
    matrix[every, :, every] = 0.5 * (diagonal + np.swapaxes(diagonal, 1, 2))
    return matrix.reshape(3 * num, 3 * num)


@one_blas_thread()
def gram_bound(edges: IntArray, tilts: FloatArray, diagonal: FloatArray) -> float:
    """Return what ``sum <L_ij, R_i^T R_j>`` is at least, for all poses of N shapes.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    tilts : ndarray, shape (E, 3, 3)
    diagonal : ndarray, shape (N, 3, 3)
    """
    matrix = gram_matrix(edges, tilts, diagonal)
    least = float(np.linalg.eigvalsh(matrix)[0]) - _rounding(matrix)
    return len(matrix) * min(0.0, least) - float(np.trace(matrix)) - _rounding(matrix)


def _rounding(matrix: FloatArray) -> float:
    """Return more than rounding can have changed an eigenvalue or the trace by."""
    return 8.0 * len(matrix) * _EPS * float(np.linalg.norm(matrix))


#: A recomputed bound may fall short of the claimed one by this much of the problem's scale (other BLAS, other order).
CLAIM_TOL = 1e-9

#: In the problem's own unit, more than all that underflow can have added to a bound: verifiers refuse numbers, and
#: quotients, beyond 1e200, and underflow loses 1e-323 of a factor.
_UNDERFLOW = 1e-100

#: For every kind of certificate, what bounds a problem by its arrays. Both are in a unit in which the points have
#: about size 1; the arrays must all be read. A kind is added here and nowhere else.
VERIFIERS: dict[str, Callable[[Problem, CertificateArrays], float]] = {
    "cells": cells_bound,
    "pm-sdp": pm_sdp_bound,
}


@one_blas_thread()
def verify_certificate(
    target: ArrayLike,
    source: ArrayLike,
    certificate: Certificate,
    *,
    problem: Problem | None = None,
) -> float:
    """Check a certificate and return the lower bound of the Procrustes matching energy that it proves.

    Parameters
    ----------
    target, source : array_like, shapes (n, d) and (k, d)
        The points that the certificate is for.
    certificate : Certificate
    problem : Problem, optional
        The problem that you want to know a bound of, for these points: a certificate of another one is refused.
        **Without it only the points are yours**, and the bound is one of the problem that the certificate itself
        states, with its allowed matches, weights, constant costs and group, whatever these are:
        :func:`pairwise.certificates.certificate.read_problem` returns it.

    Returns
    -------
    float
        No pose of this problem has a lower energy. Rounding errors are accounted for.

    Raises
    ------
    InputError
        If the certificate is malformed, for another problem, or does not prove what it claims.

    Examples
    --------
    >>> import numpy as np
    >>> import pairwise
    >>> rng = np.random.default_rng(0)
    >>> target, source = rng.random((6, 3)), rng.random((5, 3))
    >>> certificate = pairwise.solve_relaxation(target, source, group="O").certificate
    >>> mine = pairwise.Problem.from_user(target, source, group="O")
    >>> pairwise.verify_certificate(target, source, certificate, problem=mine) <= pairwise.match(
    ...     target, source, group="O"
    ... ).energy
    True
    """
    stated = read_problem(target, source, certificate)
    deviation = 0.0 if problem is None else cost_deviation(problem, stated)
    bound = proven_bound(stated, certificate.kind, certificate.arrays)
    claim = certificate.bound
    if not isinstance(claim, float | int | np.floating) or not abs(claim) <= sys.float_info.max:
        raise InputError(f"certificate: claims {claim!r}, which is no bound")
    with np.errstate(over="ignore"):
        squares = _largest(stated.weights) * (stated.target**2).sum()
        squares += (stated.weights * (stated.source**2).sum(axis=1)).sum()
        scale = min(float(squares) + _largest(stated.constant_cost), np.finfo(np.float64).max)
    if not bound >= claim - CLAIM_TOL * (scale + abs(claim)):
        raise InputError(f"certificate: claims the bound {claim:.12g} but proves {bound:.12g}")
    return bound - deviation


def proven_bound(problem: Problem, kind: str, arrays: Mapping[str, Any]) -> float:
    """Return the lower bound of a problem's energy that a certificate's arrays prove, whatever they claim.

    Raises
    ------
    InputError
        If the kind is unknown, an array is malformed or of another kind, or together they prove nothing.
    """
    verify = VERIFIERS.get(kind) if isinstance(kind, str) else None
    if verify is None:
        raise InputError(f"certificate: unknown kind {kind!r}")
    length, energy = _units(problem)
    given = CertificateArrays(arrays, energy, known=PROBLEM_ARRAYS)
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            scaled = _in_units(problem, length, energy)
            bound = float(np.ldexp(verify(scaled, given) - _UNDERFLOW, energy))
    except (FloatingPointError, np.linalg.LinAlgError, OverflowError) as error:
        raise InputError(
            f"certificate: proves nothing, its numbers are out of range ({error})"
        ) from error
    given.refuse_rest(kind)
    if not np.isfinite(bound):
        raise InputError(f"certificate: proves nothing, its bound is {bound}")
    return bound


def _units(problem: Problem) -> tuple[int, int]:
    """Return exponents (a, e): over ``2 ** a`` coordinates are at most 1, over ``2 ** e`` energies are about 1."""
    length = max(_largest(problem.target), _largest(problem.source))
    a = int(np.frexp(length)[1]) if length else 0
    return a, 2 * a + int(np.frexp(_largest(problem.weights))[1])


def _in_units(problem: Problem, length: int, energy: int) -> Problem:
    """Return the problem with coordinates in ``2 ** length`` and energies in ``2 ** energy``."""
    return replace(
        problem,
        target=in_unit(problem.target, length, "target"),
        source=in_unit(problem.source, length, "source"),
        weights=in_unit(problem.weights, energy - 2 * length, "weights"),
        constant_cost=in_unit(problem.constant_cost, energy, "certificate: constant_cost"),
    )


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))
