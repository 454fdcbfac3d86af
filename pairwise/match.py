"""Match two point sets: the best pose found, the plausible alternatives, and what is proven about them.

The steps are public functions of :mod:`pairwise.search`, :mod:`pairwise.rounding` and :mod:`pairwise.local_search`;
this module composes them.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from data_tools.arrays import read_only
from pairwise.local_search import LocalMinima
from pairwise.options import MatchOptions, Strategy
from pairwise.pattern import PatternLike
from pairwise.problem import Problem
from pairwise.results import Candidate, MatchResult
from pairwise.search import distinct, explore, look_around, mirror_rotations, of_chirality, rotation_block
from pairwise.status import Status


def match(
    target: ArrayLike,
    source: ArrayLike,
    *,
    group: str = "SO",
    candidates: ArrayLike | None = None,
    rotation_pattern: PatternLike = None,
    invariants: tuple[ArrayLike, ArrayLike] | None = None,
    weights: ArrayLike | None = None,
    num_matches: int | None = None,
    unmatched_penalty: float | None = None,
    strategy: Strategy | None = None,
    certify: bool | None = None,
    time_limit_s: float | None = None,
    seed: int | None = None,
    options: MatchOptions | None = None,
) -> MatchResult:
    """Match the source's points to the target's: rotation and injective map of least energy (Procrustes matching).

    Parameters
    ----------
    target : array_like, shape (n, d)
        Points are rows.
    source : array_like, shape (k, d)
        k <= n.
    group : {"SO", "O"}
        Rotations only, or reflections as well; with ``"O"`` both chiralities are searched, and each has its own
        candidates.
    candidates : array_like of bool, shape (n, k), optional
        Which matches are allowed.
    rotation_pattern : optional
        Blocks of R, see :meth:`pairwise.pattern.RotationPattern.from_user`; ``(3, m)`` for mixed embeddings.
    invariants : pair of array_like, shapes (n, m) and (k, m), optional
        Coordinates that no rotation changes: their squared differences are added to the costs.
    weights : array_like, shape (k,), optional
        Weight of each source point.
    num_matches : int, optional
        Two-way partial matching with that many matches.
    unmatched_penalty : float, optional
        Two-way partial matching: what each source point left out costs, in squared units of the points.
    strategy, certify, time_limit_s, seed : optional
        Override the fields of ``options`` of the same names.
    options : MatchOptions, optional

    Returns
    -------
    MatchResult

    Raises
    ------
    InputError, OptionsError
        If the arrays or the options are not as described.

    Examples
    --------
    >>> import numpy as np
    >>> target = np.random.default_rng(0).random((12, 3))
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> result = match(target, target @ quarter)
    >>> bool(np.allclose(result.R_target_source, quarter)), result.map_target_source.tolist() == list(range(12))
    (True, True)
    """
    problem = Problem.from_user(
        target,
        source,
        group=group,
        candidates=candidates,
        rotation_pattern=rotation_pattern,
        invariants=invariants,
        weights=weights,
        num_matches=num_matches,
        unmatched_penalty=unmatched_penalty,
    )
    given: dict[str, Any] = {"strategy": strategy, "certify": certify, "time_limit_s": time_limit_s, "seed": seed}
    changes = {name: value for name, value in given.items() if value is not None}
    return match_problem(problem, replace(options or MatchOptions(), **changes))


def match_problem(problem: Problem, options: MatchOptions) -> MatchResult:
    """Match as :func:`match` does, from a checked problem."""
    times_s: dict[str, float] = {}
    scale_range = options.scale_range if options.estimate_scale else None
    parts = {reflected: of_chirality(problem, reflected=reflected) for reflected in _chiralities(problem)}
    start_s = time.perf_counter()
    minima = {
        reflected: explore(part, num_rotations=options.num_rotations, seed=options.seed, scale_range=scale_range)
        for reflected, part in parts.items()
    }
    least = min(float(m.energies[0]) for m in minima.values())
    found: list[Candidate] = []
    for reflected, part in parts.items():
        seen = look_around(part, minima[reflected], least, seed=options.seed, scale_range=scale_range)
        found += _candidates(part, seen, options, reflected=reflected)
    times_s["search"] = time.perf_counter() - start_s
    ranked = _rank(found, options)
    best = ranked[0]
    return MatchResult(
        R_target_source=best.R_target_source,
        map_target_source=best.map_target_source,
        energy=best.energy,
        lower_bound=float("nan"),
        candidates=ranked,
        status=Status.LOCAL_OPTIMUM,
        times_s=times_s,
    )


def _chiralities(problem: Problem) -> tuple[bool, ...]:
    """Return whether to look for proper poses, reflected ones, or both."""
    return (False,) if problem.pattern.special_blocks else (False, True)


def _candidates(problem: Problem, minima: LocalMinima, options: MatchOptions, *, reflected: bool) -> list[Candidate]:
    """Return the distinct poses of one chirality, best first, in the coordinates of the unmirrored source."""
    block = rotation_block(problem.pattern)
    angle_rad = np.deg2rad(options.candidate_angle_deg)
    kept = distinct(minima.rotations[:, :block, :block], angle_rad, options.max_candidates)
    chosen = minima.take(kept)
    rotations = mirror_rotations(chosen.rotations) if reflected else chosen.rotations
    return [
        Candidate(
            R_target_source=read_only(rotations[c].copy()),
            map_target_source=read_only(chosen.maps[c].copy()),
            energy=float(chosen.energies[c]),
            reflected=reflected,
            origin=str(chosen.origins[c]),
            scale=float(chosen.scales[c]),
        )
        for c in range(len(chosen))
    ]


def _rank(found: list[Candidate], options: MatchOptions) -> tuple[Candidate, ...]:
    """Sort by energy and drop what is far worse than the best, but keep the best of each chirality."""
    ranked = sorted(found, key=lambda c: c.energy)
    limit = options.candidate_factor * ranked[0].energy
    firsts = {c.reflected: c for c in reversed(ranked)}
    return tuple(c for c in ranked if c.energy <= limit or c is firsts[c.reflected])
