"""The best rotation and shift of points of which some stay unmatched, proven by branch and bound over both.

How the search goes: :mod:`pairwise.branch_and_bound.motion_search`.

Compare Lian et al. (arXiv 2405.08589), another branch and bound for partial overlap.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from data_tools.arrays import read_only
from data_tools.errors import OptionsError
from data_tools.threads import one_blas_thread
from pairwise.branch_and_bound.motion_search import MotionSearch
from pairwise.branch_and_bound.prove import can_certify, deadline_of
from pairwise.problem.chirality import chiralities
from pairwise.problem.problem import Problem
from pairwise.results import Candidate
from pairwise.status import Status


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionProof:
    """What branch and bound over rotations and shifts proved.

    Attributes
    ----------
    lower_bound : float
        No rotation and shift, with no map, has a smaller energy.
    candidate : Candidate
        The best pose found, with its shift.
    status : Status
        ``PROVEN_OPTIMAL``, ``TIME_LIMIT`` or ``ITERATION_LIMIT`` (cells too small to split).
    num_cells : int
        How many cells were bounded.
    time_s : float
    """

    lower_bound: float
    candidate: Candidate
    status: Status
    num_cells: int
    time_s: float

    @property
    def statement(self) -> str:
        """What is proven, in words: what it covers and what not."""
        matched = int((self.candidate.map_target_source >= 0).sum())
        num = len(self.candidate.map_target_source)
        if self.status is not Status.PROVEN_OPTIMAL:
            return f"Not proven: no bound above {self.lower_bound:.4g} for the energy {self.candidate.energy:.4g}."
        return (
            f"No rotation, shift and one-to-one map of the {num} source points, with any unmatched that may be, has "
            f"an energy below {self.lower_bound:.4g}; this one of {self.candidate.energy:.4g} matches {matched}. "
            "Proven for these points at their given sizes, in double precision; not for the surfaces between them."
        )


@one_blas_thread()
def prove_motion(
    problem: Problem,
    candidates: Sequence[Candidate] = (),
    *,
    tol: float = 1e-2,
    time_limit_s: float | None = None,
) -> MotionProof:
    """Find the best rotation and shift of points that overlap in part, and prove it to a tolerance.

    Parameters
    ----------
    problem : Problem
        Of three dimensions, full R and unit weights, over SO(3) or O(3). Points may stay unmatched
        (``unmatched_penalty``, ``num_matches``), or not. Up to about 20 points.
    candidates : sequence of Candidate
        Poses already known; good ones save time.
    tol : float
        Proven means a lower bound of at least ``(1 - tol)`` times the energy.
    time_limit_s : float, optional
        Stop about then; no limit by default.

    Raises
    ------
    OptionsError
        If the tolerance or limit is not positive, or the problem is of another kind.

    Examples
    --------
    >>> target = np.random.default_rng(0).random((7, 3))
    >>> problem = pairwise.Problem.from_user(target, target[2:] + 0.3, unmatched_penalty=0.02)
    >>> pairwise.prove_motion(problem).status.name
    'PROVEN_OPTIMAL'
    """
    started = time.monotonic()
    deadline = deadline_of(started, tol, time_limit_s)
    if not can_prove_motion(problem):
        raise OptionsError(
            "problem: a proof over rotations and shifts needs points in space, full R and unit weights"
        )
    searches = [
        MotionSearch(part, reflected=reflected, tol=tol) for reflected, part in chiralities(problem, partial=True)
    ]
    for search in searches:
        search.start([c for c in candidates if c.reflected == search.reflected])
    for search in sorted(searches, key=lambda one: one.best.energies[0]):
        search.run(deadline, min(float(one.best.energies[0]) for one in searches))
    return _proof(searches, time.monotonic() - started)


def can_prove_motion(problem: Problem) -> bool:
    """Whether :func:`prove_motion` is for this problem."""
    return problem.dim == 3 and can_certify(problem) and bool((problem.weights == 1.0).all())


@one_blas_thread()
def certify_motion(
    problem: Problem,
    candidates: Sequence[Candidate] = (),
    *,
    tol: float = 1e-2,
    time_limit_s: float | None = None,
) -> tuple[float, Candidate, Status]:
    """Prove the optimum; the short form of :func:`prove_motion`: (lower bound, best pose, status)."""
    proof = prove_motion(problem, candidates, tol=tol, time_limit_s=time_limit_s)
    return proof.lower_bound, proof.candidate, proof.status


def _proof(searches: list[MotionSearch], time_s: float) -> MotionProof:
    best = min(searches, key=lambda search: search.best.energies[0])
    energy = float(best.best.energies[0])
    bound = min(energy, *(search.bound for search in searches))
    stuck = any(search.is_stuck for search in searches)
    done = all(search.is_done for search in searches) and not stuck
    candidate = Candidate(
        R_target_source=read_only(best.best.rotations[0] * best.signs),
        map_target_source=read_only(best.best.maps[0]),
        energy=energy,
        reflected=best.reflected,
        origin="branch and bound",
        translation=read_only(best.best.shifts[0]),
    )
    return MotionProof(
        lower_bound=bound,
        candidate=candidate,
        status=Status.PROVEN_OPTIMAL if done else Status.ITERATION_LIMIT if stuck else Status.TIME_LIMIT,
        num_cells=sum(search.num_cells for search in searches),
        time_s=time_s,
    )
