"""The portfolio: search, roundings of the relaxation and given starts compete on energy.

When the relaxation is solved: always with strategy ``"relaxation"``, never with ``"search"``. With ``"portfolio"``
where the rotation block has more than seven dimensions and the search found no exact pose: up to seven, the search
finds poses as good in a fraction of the relaxation's time; above, roundings find poses that it does not. And with
``certify`` where branch and bound does not apply.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, log

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import FloatArray, read_only
from data_tools.poses import SAME_DEG
from data_tools.rotations import rotation_angles
from pairwise.branch_and_bound.prove import can_certify
from pairwise.local_search import LocalMinima, merge, minimise
from pairwise.options import MatchOptions
from pairwise.pm_sdp.rounding import appendix_starts, draw_rotations
from pairwise.problem import Problem, with_unmatched
from pairwise.results import Candidate, RelaxationResult
from pairwise.rotation_pattern import RotationPattern
from pairwise.rotation_search import MAX_SEARCHED_DIM, apart_rotations, explore, look_around


def wants_relaxation(
    problem: Problem, options: MatchOptions, searched: LocalMinima | None = None
) -> bool:
    """Return whether the relaxation is solved, by the rule above.

    Parameters
    ----------
    problem : Problem
    options : MatchOptions
    searched : LocalMinima, optional
        What the search found, where it came first.
    """
    if searched is not None and searched.energies[0] <= problem.rounding_energy:
        return False
    beyond_search = problem.pattern.rotation_block > MAX_SEARCHED_DIM
    by_strategy = {"search": False, "relaxation": True, "portfolio": beyond_search}[
        options.strategy
    ]
    return by_strategy or (options.certify and not can_certify(problem))


def ranked_poses(
    problem: Problem,
    options: MatchOptions,
    *,
    searched: LocalMinima | None = None,
    relaxation: RelaxationResult | None = None,
    starts: FloatArray | None = None,
) -> tuple[Candidate, ...]:
    """Return the distinct locally optimal poses, best first.

    Parameters
    ----------
    problem : Problem
    options : MatchOptions
    searched : LocalMinima, optional
        What :func:`pairwise.rotation_search.explore` found, where it was asked.
    relaxation : RelaxationResult, optional
        Rounded if given.
    starts : ndarray, shape (m, d, d), optional
        Poses to descend from as well.
    """
    given, origins = _given_starts(problem, options, relaxation, starts)
    parts = []
    if len(given):
        parts.append(minimise(problem, given, hold_chirality=True, origins=origins))
    if searched is not None or not parts:
        parts.append(explore(problem, seed=options.seed) if searched is None else searched)
    polished = merge(parts)
    if options.strategy != "relaxation":
        polished = look_around(problem, polished, seed=options.seed)
    return rank_candidates(
        distinct_candidates(problem.pattern, polished, options), options, problem.rounding_energy
    )


def annealed_starts(problem: Problem, unmatched_cost: float, *, seed: int = 0) -> FloatArray:
    """Return rotations (m, d, d) to start a match with unmatched points from.

    At a small cost only rotations near the best one match anything. So the search begins at a cost at which nearly
    all points are matched, and follows its minima to smaller ones (graduated non-convexity, Blake, Zisserman 1987).

    Parameters
    ----------
    problem : Problem
        Without unmatched points.
    unmatched_cost : float
        See :func:`pairwise.problem.with_unmatched`.
    seed : int
        See :func:`pairwise.rotation_search.explore`.
    """
    found = np.zeros((0, problem.dim, problem.dim))
    for cost in costs_down_to(problem, unmatched_cost):
        eased = with_unmatched(problem, cost)
        starts = np.concatenate([found, explore(eased, seed=seed).rotations])
        found = minimise(eased, starts, hold_chirality=True).rotations
    return found


def costs_down_to(problem: Problem, unmatched_cost: float, *, factor: float = 4.0) -> list[float]:
    """Return larger costs of unmatched points, each ``factor`` times the next, down to the given one, without it.

    The largest is about the spread of the source.
    """
    largest = float(problem.weights @ (problem.source**2).sum(axis=1) / problem.weights.sum())
    num_levels = ceil(log(max(largest, unmatched_cost) / unmatched_cost, factor))
    return [unmatched_cost * factor**level for level in range(num_levels, 0, -1)]


def _given_starts(
    problem: Problem,
    options: MatchOptions,
    relaxation: RelaxationResult | None,
    starts: FloatArray | None,
) -> tuple[FloatArray, NDArray[np.str_]]:
    """Return further rotations than the search's own, of each chirality that the group has, and what gave each."""
    if starts is None and relaxation is None:
        return np.zeros((0, problem.dim, problem.dim)), np.zeros(0, dtype=np.str_)
    matrices = [np.zeros((0, problem.dim, problem.dim)) if starts is None else starts]
    origins = ["start"] * len(matrices[0])
    if relaxation is not None and np.isfinite(relaxation.R).all():
        rng = np.random.default_rng(options.seed)
        rounded = [
            appendix_starts(problem, relaxation),
            draw_rotations(problem, relaxation, options.num_draws, rng),
        ]
        matrices += rounded
        origins += ["relaxation"] * sum(map(len, rounded))
    joined, names, pattern = (
        np.concatenate(matrices),
        np.array(origins, dtype=np.str_),
        problem.pattern,
    )
    if pattern.special_blocks:
        return pattern.project(joined), names
    proper = np.zeros(len(joined), dtype=bool)
    return np.concatenate(
        [pattern.project(joined, proper), pattern.project(joined, ~proper)]
    ), np.tile(names, 2)


def distinct_candidates(
    pattern: RotationPattern, minima: LocalMinima, options: MatchOptions
) -> list[Candidate]:
    """Return the distinct poses of each chirality that the group has, best first, at most ``max_candidates`` of each.

    Parameters
    ----------
    pattern : RotationPattern
        Poses whose rotation blocks are closer than ``SAME_DEG`` are one.
    minima : LocalMinima
        Best first.
    options : MatchOptions
    """
    mirrored = pattern.mirrored(minima.rotations)
    if mirrored is None:
        return _distinct_of_one(pattern, minima, options, reflected=False)
    return [
        candidate
        for reflected in (False, True)
        for candidate in _distinct_of_one(
            pattern,
            minima.take(np.flatnonzero(mirrored == reflected)),
            options,
            reflected=reflected,
        )
    ]


def _distinct_of_one(
    pattern: RotationPattern, minima: LocalMinima, options: MatchOptions, *, reflected: bool
) -> list[Candidate]:
    """Return the distinct poses of one chirality."""
    block = pattern.rotation_block
    chosen = minima.take(
        apart_rotations(
            minima.rotations[:, :block, :block], np.deg2rad(SAME_DEG), options.max_candidates
        )
    )
    return [
        Candidate(
            R_target_source=read_only(chosen.rotations[c].copy()),
            map_target_source=read_only(chosen.maps[c].copy()),
            energy=float(chosen.energies[c]),
            reflected=reflected,
            origin=str(chosen.origins[c]),
        )
        for c in range(len(chosen))
    ]


def rank_candidates(
    candidates: Iterable[Candidate], options: MatchOptions, rounding_energy: float = 0.0
) -> tuple[Candidate, ...]:
    """Sort by energy, drop poses beyond ``candidate_factor`` times the best, keep the best of each chirality.

    No pose is dropped for what are rounding errors: copies of a box fit in several poses, all of energy 0.
    """
    ranked = sorted(candidates, key=lambda c: c.energy)
    limit = options.candidate_factor * max(ranked[0].energy, rounding_energy)
    firsts = {c.reflected: c for c in reversed(ranked)}
    return tuple(c for c in ranked if c.energy <= limit or c is firsts[c.reflected])


def with_better(
    ranked: tuple[Candidate, ...], better: Candidate, problem: Problem, options: MatchOptions
) -> tuple[Candidate, ...]:
    """Return the candidates with a pose found later, in place of those that it is not distinct from.

    A pose that is no better than the best one changes nothing.
    """
    if better.energy >= ranked[0].energy:
        return ranked
    block = problem.pattern.rotation_block

    def is_apart(other: Candidate) -> bool:
        first, second = (c.R_target_source[:block, :block] for c in (better, other))
        return bool(rotation_angles(first, second) >= np.deg2rad(SAME_DEG))

    return rank_candidates(
        [better, *(c for c in ranked if is_apart(c))], options, problem.rounding_energy
    )
