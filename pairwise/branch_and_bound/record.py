"""Writes down a proof by quasi-bounds: the depths of the leaves of the tree say which cells they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_tools.arrays import IntArray
from pairwise.branch_and_bound.cells import MAX_DEPTH
from pairwise.branch_and_bound.search import RotationSearch
from pairwise.certificates.certificate import Certificate, hash_problem, problem_arrays
from pairwise.certificates.verify import proven_bound
from pairwise.problem.problem import Problem

#: The certificate's name in :data:`pairwise.certificates.verify.VERIFIERS`.
KIND = "cells"


def depths_of(searches: Sequence[RotationSearch]) -> list[IntArray]:
    """Return the depths of the leaves in the order of faces and paths, of rotations and then of reflections."""
    leaves = [search.leaves.cells for search in sorted(searches, key=lambda one: one.reflected)]
    return [one.depths[np.lexsort((one.paths << (MAX_DEPTH - one.depths), one.faces))] for one in leaves]


def make_certificate(problem: Problem, searches: Sequence[RotationSearch]) -> Certificate:
    """Return the certificate of what searches of all chiralities of a problem have proven so far."""
    named = zip(("proper", "reflected"), depths_of(searches), strict=False)
    arrays = problem_arrays(problem) | {f"{name}_depths": depths.astype(np.uint8) for name, depths in named}
    bound = proven_bound(problem, KIND, arrays)
    return Certificate(kind=KIND, arrays=arrays, problem_hash=hash_problem(problem), bound=bound)
