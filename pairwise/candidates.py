"""The plausible poses of a pair: distinct local minima, the best of each chirality always among them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from data_tools.arrays import read_only
from data_tools.poses import SAME_DEG
from data_tools.rotations import rotation_angles
from pairwise.local.local_search import LocalMinima
from pairwise.local.rotation_search import apart_rotations
from pairwise.options import MatchOptions
from pairwise.problem.pattern import RotationPattern
from pairwise.problem.problem import Problem
from pairwise.results import Candidate


def distinct_candidates(pattern: RotationPattern, minima: LocalMinima, options: MatchOptions) -> list[Candidate]:
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
            pattern, minima.take(np.flatnonzero(mirrored == reflected)), options, reflected=reflected
        )
    ]


def _distinct_of_one(
    pattern: RotationPattern, minima: LocalMinima, options: MatchOptions, *, reflected: bool
) -> list[Candidate]:
    """Return the distinct poses of one chirality."""
    block = pattern.rotation_block
    chosen = minima.take(
        apart_rotations(minima.rotations[:, :block, :block], np.deg2rad(SAME_DEG), options.max_candidates)
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

    return rank_candidates([better, *(c for c in ranked if is_apart(c))], options, problem.rounding_energy)
