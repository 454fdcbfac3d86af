"""Match two point sets: the best pose found, the plausible alternatives, and what is proven about them.

The steps are public functions of :mod:`pairwise.portfolio`, :mod:`pairwise.rotation_search`,
:mod:`pairwise.pm_sdp.rounding` and :mod:`pairwise.local_search`; this module composes them.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain, repeat
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, as_rotations, read_only
from data_tools.checks import as_options, check_number
from data_tools.threads import one_blas_thread
from pairwise.branch_and_bound.prove import can_certify, prove
from pairwise.local_search import minimise
from pairwise.options import BUILT_IN, MatchOptions, PairKeywords
from pairwise.portfolio import (
    annealed_starts,
    costs_down_to,
    ranked_poses,
    wants_relaxation,
    with_better,
)
from pairwise.problem import Problem, ProblemArguments, marked_unmatched, with_unmatched
from pairwise.relaxations import check_solver, solve_pm_sdp
from pairwise.results import Candidate, MatchResult, RelaxationResult, Status
from pairwise.rotation_search import explore

#: A shift of more than this share of the points' spread is said.
SHIFTED = 0.1
#: Relative gap between energy and bound at which a pose counts as proven.
GAP_TOL = 1e-3


class MatchKeywords(PairKeywords, ProblemArguments, total=False):
    """The fields of :class:`MatchOptions` and what makes a problem, as keywords of :func:`match`."""

    certify: bool
    seed: int


@one_blas_thread()
def match(
    target: ArrayLike,
    source: ArrayLike,
    *,
    translation: bool = False,
    unmatched_cost: float | None = None,
    starts: ArrayLike | None = None,
    options: MatchOptions | Mapping[str, Any] | None = None,
    **keywords: Unpack[MatchKeywords],
) -> MatchResult:
    """Match the source's points to the target's: rotation and injective map of least energy (Procrustes matching).

    Every source point is matched unless ``unmatched_cost`` is given: do so where the sets have outliers or overlap in
    part. Of surfaces that overlap in part, :func:`collalign.match_in_part` finds poses and scales by their normals.

    Parameters
    ----------
    target : array_like, shape (n, d)
        Points are rows.
    source : array_like, shape (k, d)
        k <= n.
    translation : bool
        Poses rotate about the origin; this shifts both sets to their centroids first, which is the best shift where
        all points of both sets are matched and weigh the same. Energies, bounds and certificates are then of the
        shifted points. A warning says where a shift is most of what a pose about the origin leaves. With
        ``unmatched_cost`` the centroids are those of the matched points, found in turns with the pose.
    unmatched_cost : float, optional
        What an unmatched source point costs, in squared units of the points; all are matched by default. A point
        whose match would be further away than its root stays unmatched: take three to four times the noise, squared.
        Energy, bound and certificate are those of :func:`pairwise.with_unmatched`.
    starts : array_like, shape (m, d, d), optional
        Poses to descend from as well.
    options : MatchOptions or mapping, optional
    **keywords
        Fields of ``options`` by themselves, which win; and what makes the problem in addition to the points, see
        :meth:`pairwise.Problem.from_user`: ``group`` ("SO", or "O", where both chiralities are searched and each has
        its own candidates), ``allowed`` matches, ``rotation_pattern`` (``(3, m)`` for mixed embeddings),
        ``invariants`` and ``weights``.

    Returns
    -------
    MatchResult
        Its ``lower_bound`` is the relaxation's where that was solved, or the proof's with ``certify``, and 0 for an
        exact match; NaN otherwise, and for banded patterns, whose bound is one for banded R only, while poses are any
        rotations. Its ``log`` says what was solved. Unmatched points have -1 in its maps.

    Raises
    ------
    InputError, OptionsError
        If the arrays or the options are not as described.
    UnavailableError
        If the solver of the relaxation is not installed.

    See Also
    --------
    collalign.match_in_part : of surfaces that overlap in part
    pairwise.with_unmatched : the problem with unmatched points, to relax, prove or verify by itself

    Examples
    --------
    >>> target = np.random.default_rng(0).random((12, 3))
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> result = pairwise.match(target, target @ quarter)
    >>> bool(np.allclose(result.R_target_source, quarter)), result.map_target_source.tolist() == list(range(12))
    (True, True)
    """
    given: dict[str, Any] = {**keywords}
    about = {name: given.pop(name) for name in ProblemArguments.__annotations__ if name in given}
    problem = Problem.from_user(target, source, **about)
    centres = (np.zeros(problem.dim),) * 2
    if translation:
        problem, centres = _about_centroids(problem)
    poses = None
    if starts is not None:
        group = about.get("group", "SO")
        poses = as_rotations(starts, "starts", group=group, dim=problem.dim).reshape(
            -1, problem.dim, problem.dim
        )
    options = as_options("options", options, MatchOptions, given)
    if unmatched_cost is not None:
        result, centres = _match_some(
            problem, unmatched_cost, options, poses, centres if translation else None
        )
    else:
        result = match_problem(problem, options, starts=poses)
    if unmatched_cost is None:
        _warn_of_shift(problem, result.candidates[0])
    if not translation:
        return result
    shifts = (read_only(centres[0] - c.R_target_source @ centres[1]) for c in result.candidates)
    ranked = tuple(
        replace(c, translation=shift) for c, shift in zip(result.candidates, shifts, strict=True)
    )
    return replace(result, translation=ranked[0].translation, candidates=ranked)


def _warn_of_shift(problem: Problem, best: Candidate) -> None:
    """Warn where most of what a pose leaves is a shift, which a pose about the origin cannot take."""
    matched = problem.target[best.map_target_source]
    rest = matched - problem.source @ best.R_target_source.T
    shift, spread = (
        float(np.linalg.norm(rest.mean(axis=0))),
        float(np.sqrt(matched.var(axis=0).sum())),
    )
    if shift > SHIFTED * spread > 0 and shift**2 > 0.5 * (rest**2).sum(axis=1).mean():
        centroids = problem.target.mean(axis=0), problem.source.mean(axis=0)
        is_centred = max(map(np.linalg.norm, centroids)) < SHIFTED * shift
        reason = (
            "both sets are at their centroids, and some target points have no partner. Use translation=True with a "
            "large unmatched_cost, which shifts to the centroids of the matched points"
            if is_centred
            else "poses rotate about the origin. Use translation=True to shift both sets to their centroids first"
        )
        warnings.warn(
            f"the matched points are {shift:.3g} apart on average, {shift / spread:.2g} spreads, because {reason}",
            stacklevel=4,
        )


def _match_some(
    problem: Problem,
    cost: float,
    options: MatchOptions,
    starts: FloatArray | None,
    centres: tuple[FloatArray, FloatArray] | None,
) -> tuple[MatchResult, tuple[FloatArray, FloatArray]]:
    """Match with unmatched points, and return what both sets were shifted by in all: about the points that match."""
    check_number("unmatched_cost", cost, positive=True)
    shifts = (np.zeros(problem.dim),) * 2 if centres is None else centres
    if centres is not None:
        problem, moves = _about_matched(problem, cost, options.seed)
        shifts = shifts[0] + moves[0], shifts[1] + moves[1]
    tried = annealed_starts(problem, cost, seed=options.seed)
    tried = tried if starts is None else np.concatenate([starts, tried])
    result = match_problem(
        with_unmatched(problem, cost), options, starts=tried if len(tried) else None
    )
    num = problem.num_target
    ranked = tuple(
        replace(c, map_target_source=marked_unmatched(c.map_target_source, num))
        for c in result.candidates
    )
    return replace(result, map_target_source=ranked[0].map_target_source, candidates=ranked), shifts


def _about_matched(
    problem: Problem, cost: float, seed: int
) -> tuple[Problem, tuple[FloatArray, FloatArray]]:
    """Return the problem with both sets shifted about the points that match, and the shifts.

    Costs fall as those of :func:`pairwise.portfolio.annealed_starts` do; the last one is repeated until the energy
    falls no more.
    """
    shifts = (np.zeros(problem.dim),) * 2
    former, starts = np.inf, np.zeros((0, problem.dim, problem.dim))
    for level in chain(costs_down_to(problem, cost), repeat(cost)):
        eased = with_unmatched(problem, level)
        tried = np.concatenate([starts, explore(eased, seed=seed).rotations])
        found = minimise(eased, tried, hold_chirality=True)
        starts, best = found.rotations, found.maps[0]
        matched = np.flatnonzero(best < problem.num_target)
        if not len(matched) or (
            level == cost and found.energies[0] >= former - eased.rounding_energy
        ):
            break
        if level == cost:
            former = found.energies[0]
        weights = problem.weights[matched] / problem.weights[matched].sum()
        moves = weights @ problem.target[best[matched]], weights @ problem.source[matched]
        target, source = (
            read_only(p - move)
            for p, move in zip((problem.target, problem.source), moves, strict=True)
        )
        problem = replace(problem, target=target, source=source)
        shifts = shifts[0] + moves[0], shifts[1] + moves[1]
    return problem, shifts


def _about_centroids(problem: Problem) -> tuple[Problem, tuple[FloatArray, FloatArray]]:
    """Return the problem with both point sets about their centroids, and the centroids."""
    centres = problem.target.mean(axis=0), problem.source.mean(axis=0)
    target, source = problem.target - centres[0], problem.source - centres[1]
    return replace(problem, target=read_only(target), source=read_only(source)), centres


@one_blas_thread()
def match_problem(
    problem: Problem, options: MatchOptions, *, starts: FloatArray | None = None
) -> MatchResult:
    """Match as :func:`match` does, from a checked problem and checked starts (m, d, d)."""
    check_solver(options.solver)
    began_s, log = time.monotonic(), []

    def left_s() -> float | None:
        spent_s = time.monotonic() - began_s
        return None if options.time_limit_s is None else max(options.time_limit_s - spent_s, 1e-3)

    searched = relaxation = None
    size = f"{problem.num_source} on {problem.num_target} points in {problem.dim} dimensions"
    if options.strategy != "relaxation":
        searched = explore(problem, seed=options.seed)
        log.append(f"Searched rotations of {size}: {len(searched)} local minima.")
    if wants_relaxation(problem, options, searched):
        relaxation = solve_pm_sdp(
            problem,
            solver=options.solver,
            row_sums=options.row_sums,
            tol=GAP_TOL if options.solver == BUILT_IN else None,
            time_limit_s=left_s(),
        )
        log.append(f"Solved PM-SDP of {size} ({options.solver}): {relaxation.status.value}")
        if relaxation.status is Status.FAILED:
            relaxation = None
    ranked = ranked_poses(problem, options, searched=searched, relaxation=relaxation, starts=starts)
    bound, status = _proven(problem, relaxation, ranked[0])
    if options.certify and status is not Status.PROVEN_OPTIMAL and can_certify(problem):
        proof = prove(problem, ranked, tol=GAP_TOL, time_limit_s=left_s())
        log.append(
            f"Branch and bound over rotations, {proof.num_cells} cells: {proof.status.value}"
        )
        ranked, status = with_better(ranked, proof.candidate, problem, options), proof.status
        bound = min(float(np.fmax(bound, max(proof.lower_bound, 0.0))), ranked[0].energy)
    best = ranked[0]
    return MatchResult(
        R_target_source=best.R_target_source,
        map_target_source=best.map_target_source,
        energy=best.energy,
        lower_bound=bound,
        candidates=ranked,
        status=status,
        certificate=None if relaxation is None else relaxation.certificate,
        log=tuple(log),
    )


def _proven(
    problem: Problem, relaxation: RelaxationResult | None, best: Candidate
) -> tuple[float, Status]:
    """Return the bound, and whether it proves the best pose: the relaxation's, 0 for an exact match, or NaN."""
    bound = 0.0 if best.energy <= problem.rounding_energy else np.nan
    if relaxation is not None and problem.pattern.is_block_diagonal:
        bound = min(max(relaxation.lower_bound, 0.0), best.energy)
    if bound >= (1.0 - GAP_TOL) * best.energy - problem.rounding_energy:
        return bound, Status.PROVEN_OPTIMAL
    is_stopped = relaxation is not None and relaxation.status is Status.TIME_LIMIT
    return bound, Status.TIME_LIMIT if is_stopped else Status.LOCAL_OPTIMUM
