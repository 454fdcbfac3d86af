"""Writes down a proof by quasi-bounds: every leaf of the tree with the potentials that close it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pairwise.branch_and_bound.search import RotationSearch
from pairwise.certificates.certificate import Certificate, hash_problem, problem_arrays
from pairwise.certificates.verify import proven_bound
from pairwise.problem.problem import Problem

#: The certificate's name in :data:`pairwise.certificates.verify.VERIFIERS`.
KIND = "cells"
#: Potentials are kept in single precision where the bound falls by no more than this share.
_SINGLE_LOSS = 1e-5


def make_certificate(problem: Problem, searches: Sequence[RotationSearch]) -> Certificate:
    """Return the certificate of what searches of all chiralities of a problem have proven so far."""
    doubles: dict[str, NDArray[Any]] = problem_arrays(problem)
    for search in searches:
        name, leaves = "reflected" if search.reflected else "proper", search.leaves
        used, evidence = np.unique(leaves.sources, return_inverse=True)
        doubles[f"{name}_faces"] = leaves.cells.faces.astype(np.uint8)
        doubles[f"{name}_depths"] = leaves.cells.depths.astype(np.uint8)
        doubles[f"{name}_paths"] = leaves.cells.paths
        doubles[f"{name}_evidence"] = evidence.astype(np.int32)
        doubles[f"{name}_potentials"] = search.potentials[used]
    certificate = _certificate(problem, doubles)
    if any(np.abs(search.potentials).max() > np.finfo(np.float32).max for search in searches):
        return certificate
    single = _certificate(problem, {name: _in_single(name, values) for name, values in doubles.items()})
    is_enough = single.bound >= certificate.bound - _SINGLE_LOSS * abs(certificate.bound)
    return single if is_enough else certificate


def _certificate(problem: Problem, arrays: dict[str, NDArray[Any]]) -> Certificate:
    bound = proven_bound(problem, KIND, arrays)
    return Certificate(kind=KIND, arrays=arrays, problem_hash=hash_problem(problem), bound=bound)


def _in_single(name: str, values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.float32) if name.endswith("_potentials") else values
