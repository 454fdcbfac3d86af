"""Certified optimum of Procrustes matching in the plane and in space, by branch and bound over the rotations.

Boxes of rotations (:mod:`pairwise.branch_and_bound.bounds`) are split, the least bounded first, until none can hold
a pose better than the best one found by more than the tolerance (:mod:`pairwise.branch_and_bound.bounds`). Where all
points of a shape lie on one line through the origin the best rotations fill curves: small tolerances then take long.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import OptionsError
from data_tools.threads import one_blas_thread
from pairwise.branch_and_bound.search import RotationSearch
from pairwise.certificates.certificate import Certificate, hash_problem, problem_arrays
from pairwise.certificates.verify import proven_bound
from pairwise.certificates.verify_cells import DEEPEST
from pairwise.problem import Problem, chiralities
from pairwise.results import Candidate, Status
from pairwise.rotation_search import screen
from pairwise.rotation_sets import rotation_set

#: Rotations that are screened before anything is bounded, and how many of them the best pose is sought from.
_NUM_SCREENED, _NUM_STARTS = 256, 4
#: The certificate's name in :data:`pairwise.certificates.verify.VERIFIERS`.
KIND = "cells"


@dataclass(frozen=True, kw_only=True, eq=False)
class Proof:
    """What branch and bound proved.

    Attributes
    ----------
    lower_bound : float
        No pose has a smaller energy.
    candidate : Candidate
        The best pose found.
    status : Status
        ``PROVEN_OPTIMAL``, ``TIME_LIMIT``, or ``ITERATION_LIMIT`` (cells too small to split).
    proper_bound, reflected_bound : float
        No rotation, and no reflection, has a smaller energy; NaN where the group has none.
    num_cells : int
        How many cells were bounded.
    certificate : Certificate or None
        Where it was asked for: the leaves of the tree with what closes each, which
        :func:`pairwise.verify_certificate` checks by code of its own.
    """

    lower_bound: float
    candidate: Candidate
    status: Status
    proper_bound: float
    reflected_bound: float
    num_cells: int
    certificate: Certificate | None = None

    @property
    def is_chirality_proven(self) -> bool:
        """Whether every pose of the other chirality is proven to be worse than the best one."""
        other = self.proper_bound if self.candidate.reflected else self.reflected_bound
        return bool(other > self.candidate.energy)


def can_certify(problem: Problem) -> bool:
    """Return whether :func:`prove` is for this problem: dimension 2 or 3 and full R."""
    try:
        chiralities(problem)
    except OptionsError:
        return False
    return True


@one_blas_thread()
def prove(
    problem: Problem,
    candidates: Sequence[Candidate] = (),
    *,
    tol: float = 1e-3,
    time_limit_s: float | None = None,
    record: bool = False,
) -> Proof:
    """Find the best pose and prove it to a tolerance, or say how far the proof has come.

    Parameters
    ----------
    problem : Problem
        Dimension 2 or 3, full R; k <= n, allowed matches, weights and constant costs as you like.
    candidates : sequence of Candidate
        Poses already known; good ones save time.
    tol : float
        Proven means a lower bound of at least ``(1 - tol)`` times the energy (plus 1e-9 of the problem's scale).
    time_limit_s : float, optional
        Stop about then; no limit by default.
    record : bool
        Write the proof down.

    Raises
    ------
    OptionsError
        If the tolerance or limit is not positive, or the problem is of another kind (:func:`can_certify`).

    Examples
    --------
    >>> target = np.random.default_rng(0).random((8, 3))
    >>> pairwise.prove(pairwise.Problem.from_user(target, target[::-1])).status.name
    'PROVEN_OPTIMAL'
    """
    deadline = deadline_of(tol, time_limit_s)
    rotations = [c.R_target_source for c in candidates]
    searches = searches_of(problem, np.array(rotations) if rotations else None, tol)
    proof = finish(searches, deadline)
    return replace(proof, certificate=make_certificate(problem, searches)) if record else proof


def deadline_of(tol: float, time_limit_s: float | None) -> float:
    """Check the options and return when to stop, counted from now.

    Raises
    ------
    OptionsError
        If the tolerance or limit is not positive.
    """
    for name, number in (("tol", tol), ("time_limit_s", time_limit_s or 1.0)):
        if not number > 0:
            raise OptionsError(f"{name}: expected a positive number, got {number}")
    return time.monotonic() + (math.inf if time_limit_s is None else time_limit_s)


def searches_of(problem: Problem, known: FloatArray | None, tol: float) -> list[RotationSearch]:
    """Return a search of each chirality, the one with the better pose first.

    Parameters
    ----------
    problem : Problem
    known : ndarray, shape (m, d, d), optional
        Poses to descend from; of a chirality that has none, those of an even set that look best.
    tol : float

    Raises
    ------
    OptionsError
        If the problem is not for this (:func:`can_certify`).
    """
    searches = []
    for reflected, part in chiralities(problem):
        search = RotationSearch(part, reflected=reflected, tol=tol)
        own = np.zeros((0, problem.dim, problem.dim)) if known is None else known
        own = own[(np.linalg.det(own) < 0) == reflected]
        if len(own):
            search.descend(own * search.signs)
        else:
            search.descend(screen(part, rotation_set(problem.dim, _NUM_SCREENED))[0][:_NUM_STARTS])
        searches.append(search)
    return sorted(searches, key=lambda search: search.energy)


def finish(searches: list[RotationSearch], deadline: float) -> Proof:
    """Run searches of a problem's chiralities to the end, or to the deadline."""
    for search in searches:
        search.run(deadline, min(other.energy for other in searches))
    return _proof(searches)


def _proof(searches: list[RotationSearch]) -> Proof:
    best = min(searches, key=lambda search: search.energy)
    bounds = {search.reflected: search.bound for search in searches}
    is_proven = all(search.is_done(best.energy) for search in searches)
    stuck = any(search.is_stuck for search in searches)
    status = (
        Status.PROVEN_OPTIMAL
        if is_proven
        else Status.ITERATION_LIMIT
        if stuck
        else Status.TIME_LIMIT
    )
    candidate = Candidate(
        R_target_source=read_only(best.rotation * best.signs),
        map_target_source=read_only(best.map),
        energy=best.energy,
        reflected=best.reflected,
        origin="branch and bound",
    )
    return Proof(
        lower_bound=min(*bounds.values(), best.energy),
        candidate=candidate,
        status=status,
        proper_bound=bounds[False],
        reflected_bound=bounds.get(True, math.nan),
        num_cells=sum(search.num_cells for search in searches),
    )


def depths_of(searches: Sequence[RotationSearch]) -> list[IntArray]:
    """Return the depths (m,) of the leaves by faces and paths, an array of rotations and then one of reflections."""
    leaves = [search.leaves.cells for search in sorted(searches, key=lambda one: one.reflected)]
    return [
        one.depths[np.lexsort((one.paths << (DEEPEST - one.depths), one.faces))] for one in leaves
    ]


def make_certificate(problem: Problem, searches: Sequence[RotationSearch]) -> Certificate:
    """Return the certificate of what searches of all chiralities of a problem have proven so far."""
    named = zip(("proper", "reflected"), depths_of(searches), strict=False)
    arrays = problem_arrays(problem) | {
        f"{name}_depths": depths.astype(np.uint8) for name, depths in named
    }
    bound = proven_bound(problem, KIND, arrays)
    return Certificate(kind=KIND, arrays=arrays, problem_hash=hash_problem(problem), bound=bound)
