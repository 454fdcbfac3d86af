"""Certified optimum of Procrustes matching in the plane and in space, by branch and bound over the rotations.

Boxes of rotations (:mod:`pairwise.branch_and_bound.cells`) are split, the least bounded first, until none can hold
a pose better than the best one found by more than the tolerance (:mod:`pairwise.branch_and_bound.bounds`). Where
this does not end within half of the time, the tight relaxation bounds the whole group once and rules out matches
for what follows.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import read_only
from data_tools.errors import OptionsError
from data_tools.threads import one_blas_thread
from pairwise.branch_and_bound.search import ChiralitySearch
from pairwise.local.rotation_sets import rotation_set
from pairwise.problem.problem import Problem
from pairwise.results import Candidate
from pairwise.status import Status
from pairwise.tight.problem import chiralities

#: Rotations from which the best pose is sought before anything is bounded.
_NUM_STARTS = 64


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
    time_s : float
    """

    lower_bound: float
    candidate: Candidate
    status: Status
    proper_bound: float
    reflected_bound: float
    num_cells: int
    time_s: float

    @property
    def is_chirality_proven(self) -> bool:
        """Whether every pose of the other chirality is proven to be worse than the best one."""
        other = self.proper_bound if self.candidate.reflected else self.reflected_bound
        return bool(other > self.candidate.energy)


def can_certify(problem: Problem) -> bool:
    """Whether :func:`certify` is for this problem: dimension 2 or 3, full R, no partial matching."""
    try:
        chiralities(problem)
    except OptionsError:
        return False
    return True


@one_blas_thread()
def certify(
    problem: Problem,
    candidates: Sequence[Candidate] = (),
    *,
    tol: float = 1e-3,
    time_limit_s: float | None = None,
) -> tuple[float, Candidate, Status]:
    """Prove the optimum; see :func:`prove`, of which this is the short form: (lower bound, best pose, status)."""
    proof = prove(problem, candidates, tol=tol, time_limit_s=time_limit_s)
    return proof.lower_bound, proof.candidate, proof.status


@one_blas_thread()
def prove(
    problem: Problem,
    candidates: Sequence[Candidate] = (),
    *,
    tol: float = 1e-3,
    time_limit_s: float | None = None,
) -> Proof:
    """Find the best pose and prove it to a tolerance, or say how far the proof has come.

    Parameters
    ----------
    problem : Problem
        Dimension 2 or 3, full R; k <= n, candidates, weights and constant costs as you like.
    candidates : sequence of Candidate
        Poses already known; good ones save time.
    tol : float
        Proven means a lower bound of at least ``(1 - tol)`` times the energy (plus 1e-9 of the problem's scale).
    time_limit_s : float, optional
        Stop about then; no limit by default.

    Raises
    ------
    OptionsError
        If the tolerance or limit is not positive, or the problem is of another kind (:func:`can_certify`).
    """
    for name, number in (("tol", tol), ("time_limit_s", time_limit_s or 1.0)):
        if not number > 0:
            raise OptionsError(f"{name}: expected a positive number, got {number}")
    started = time.monotonic()
    limit = math.inf if time_limit_s is None else time_limit_s
    searches = [ChiralitySearch(part, reflected=reflected, tol=tol) for reflected, part in chiralities(problem)]
    for search in searches:
        known = [c.R_target_source * search.signs for c in candidates if c.reflected == search.reflected]
        search.descend(np.concatenate([rotation_set(problem.dim, _NUM_STARTS), *(r[None] for r in known)]))
    searches.sort(key=lambda search: search.energy)
    for share, is_last in ((0.5, False), (1.0, True)):
        for search in searches:
            search.run(started + share * limit, min(other.energy for other in searches))
        best = min(search.energy for search in searches)
        unfinished = [search for search in searches if not search.is_done(best)]
        if is_last or not unfinished:
            break
        for number, search in enumerate(unfinished, start=1):
            search.use_relaxation(started + (0.5 + 0.25 * number / len(unfinished)) * limit, best)
    return _proof(searches, time.monotonic() - started)


def _proof(searches: list[ChiralitySearch], time_s: float) -> Proof:
    best = min(searches, key=lambda search: search.energy)
    bounds = {search.reflected: search.bound for search in searches}
    is_proven = all(search.is_done(best.energy) for search in searches)
    stuck = any(search.is_stuck for search in searches)
    status = Status.PROVEN_OPTIMAL if is_proven else Status.ITERATION_LIMIT if stuck else Status.TIME_LIMIT
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
        time_s=time_s,
    )
