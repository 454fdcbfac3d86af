"""Checks certificates without the solvers: is it for this problem, and does it prove what it claims."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray
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
from pairwise.problem.problem import Problem

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
        squares = (stated.target**2).sum() + (stated.weights * (stated.source**2).sum(axis=1)).sum()
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
