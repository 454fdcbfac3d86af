"""Matches two whole shapes: the candidates of the search, and those that neighbourhoods propose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.confidence.candidate_model import candidate_costs
from collalign.whole_pairs.local_evidence import CONVINCING, local_evidence, proposed_rotations
from collalign.whole_pairs.problem import match_at_rotation, pair_problem
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.errors import SolveFailed
from pairwise.matching import match_problem
from pairwise.options import MatchOptions
from pairwise.results import Candidate, MatchResult


def match_whole(
    target: Samples, source: Samples, group: str, options: MatchOptions
) -> tuple[MatchResult, FloatArray]:
    """Match two whole shapes, and compare their neighbourhoods at each pose.

    Parameters
    ----------
    target, source : Samples
    group : {"SO", "O"}
    options : MatchOptions

    Returns
    -------
    result : MatchResult
        Its candidates by energy, which is 0 where it is of rounding size. Where the likeliest one overlaps little,
        those that neighbourhoods propose are among them.
    mismatches : ndarray, shape (m,)
        Of the neighbourhoods at each candidate, NaN where they are not known.

    Raises
    ------
    SolveFailed
        If there is no pose.
    """
    problem = pair_problem(target, source, group)
    result = match_problem(problem, options)
    if not result.candidates:
        raise SolveFailed(result.status.value, result)
    poses = tuple(
        replace(pose, energy=0.0) if pose.energy <= problem.rounding_energy else pose
        for pose in result.candidates
    )
    rotations = np.array([pose.R_target_source for pose in poses])
    mismatches, overlaps = local_evidence(target, source, rotations)
    best = int(np.argmin(candidate_costs(np.array([one.energy for one in poses]), mismatches)))
    if problem.dim == 3 and overlaps[best] < CONVINCING:
        proposed = proposed_rotations(target, source, group, rotations)
        poses += tuple(_candidate_at(target, source, rotation) for rotation in proposed)
        mismatches = np.append(mismatches, local_evidence(target, source, proposed)[0])
    order = np.argsort([pose.energy for pose in poses], kind="stable")
    return replace(result, candidates=tuple(poses[n] for n in order)), mismatches[order]


def _candidate_at(target: Samples, source: Samples, rotation: FloatArray) -> Candidate:
    """Return the candidate of a rotation (3, 3) that neighbourhoods propose."""
    matched, energy = match_at_rotation(target, source, rotation)
    return Candidate(
        R_target_source=rotation,
        map_target_source=matched,
        energy=energy,
        reflected=bool(np.linalg.det(rotation) < 0),
        origin="neighbourhoods",
    )
