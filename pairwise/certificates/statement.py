"""What a certificate is about: the problem that it brings, read as strictly as one that a caller gives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from data_tools.arrays import BoolArray, FloatArray, IntArray, as_points
from data_tools.errors import InputError
from pairwise.certificates.arrays import CertificateArrays
from pairwise.certificates.certificate import Certificate, hash_problem, problem_arrays
from pairwise.problem.pattern import RotationPattern
from pairwise.problem.problem import Problem

#: Constant costs are computed from invariants, which another processor rounds in another way: relative difference.
_COST_TOL = 1e-12


def read_problem(target: ArrayLike, source: ArrayLike, certificate: Certificate) -> Problem:
    """Return the problem that a certificate says it is of, for points of shape (n, d) and (k, d).

    Allowed matches, weights, constant costs, pattern and group are the certificate's own words: look at them
    before you believe a bound that was not checked against a problem of yours.

    Raises
    ------
    InputError
        If an array is missing or malformed, if together they make no problem, or if it is not the problem whose hash
        the certificate bears.
    """
    problem = build_problem(as_points(target, "target"), as_points(source, "source"), certificate.arrays)
    if not isinstance(certificate.problem_hash, str) or hash_problem(problem) != certificate.problem_hash:
        raise InputError("certificate: is for another problem (the hash of points and options differs)")
    return problem


def build_problem(q: FloatArray, p: FloatArray, arrays: Mapping[str, Any]) -> Problem:
    """Build the problem of points (n, d) and (k, d) and of a certificate's arrays, once they fit each other."""
    (n, d), k = q.shape, len(p)
    if k > n or p.shape[1] != d:
        raise InputError(f"target and source: {q.shape} and {p.shape} points make no problem (k <= n, one dimension)")
    given = CertificateArrays(arrays)
    weights = given.floats("weights", (k,))
    if (weights < 0).any() or not (weights > 0).any():
        raise InputError("certificate: weights must not be negative, nor all zero")
    pattern = given.bools("pattern", (d, d))
    blocks = given.indices("special_blocks", (None, 2), upper=d + 1)
    _check_blocks(pattern, blocks)
    problem = Problem(
        target=q,
        source=p,
        pattern=RotationPattern(pattern, tuple((int(a), int(b)) for a, b in blocks)),
        allowed=given.bools("candidates", (n, k)),
        weights=weights,
        constant_cost=given.floats("constant_cost", (n, k)),
    )
    if _num_left_over(problem.allowed):
        raise InputError("certificate: no injective map fits the matches that it allows")
    return problem


def cost_deviation(stated: Problem, found: Problem) -> float:
    """Return how much the energies of two problems may differ, once it is sure that they are the same.

    Raises
    ------
    InputError
        If they differ in anything but the rounding of constant costs.
    """
    ours, theirs = ({**problem_arrays(p), "target": p.target, "source": p.source} for p in (stated, found))
    other = [name for name in sorted({*ours, *theirs}) if name not in ours or name not in theirs]
    other += [n for n in ours if n in theirs and n != "constant_cost" and not np.array_equal(ours[n], theirs[n])]
    ours_cost, theirs_cost = stated.constant_cost, found.constant_cost
    if ours_cost.shape != theirs_cost.shape or not np.allclose(ours_cost, theirs_cost, rtol=_COST_TOL, atol=0.0):
        other.append("constant_cost")
    if other:
        raise InputError(f"certificate: is for another problem than yours, which differs in {', '.join(other)}")
    return float(np.abs(ours_cost - theirs_cost).max(axis=0).sum())


def _check_blocks(pattern: BoolArray, blocks: IntArray) -> None:
    """Refuse rotation blocks that are empty, overlap, or are not separate, and patterns of singular matrices."""
    taken = np.zeros(len(pattern), dtype=bool)
    for start, stop in blocks:
        inside = np.zeros(len(pattern), dtype=bool)
        inside[start:stop] = True
        if stop - start < 2 or (taken & inside).any() or (pattern & (inside[:, None] != inside)).any():
            raise InputError(f"certificate: special_blocks has [{start}, {stop}], which is no block of the pattern")
        taken |= inside
    if _num_left_over(pattern):
        raise InputError("certificate: every matrix with its pattern is singular")


def _num_left_over(allowed: BoolArray) -> int:
    """Return how many columns a largest matching leaves out."""
    return int((maximum_bipartite_matching(csr_array(allowed), perm_type="row") < 0).sum())
