"""Pairs at poses that the collection asks for: solved again from these, or matched at them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from collalign.engine.job import Shared, SharedTable
from collalign.engine.records import Record
from collalign.options import AlignSession
from collalign.products.pair import AlignedPair, Pair
from collalign.synchronization import SynchronizationResult
from collalign.whole_pairs.local_evidence import local_evidence
from collalign.whole_pairs.problem import match_at_rotation, pair_problem
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.rotations import rotation_angle_deg
from pairwise.local_search import minimise

Solved = TypeVar("Solved")

#: Poses of a pair within so many radians are one.
SAME_POSE_RAD = np.deg2rad(1.0)


def resolve_pair(target: Samples, source: Samples, group: str, start: FloatArray) -> Record:
    """Return the local minimum of a pair's energy next to a rotation of space; runs inside a worker.

    Returns
    -------
    dict
        ``rotations`` (1, d, d), ``maps`` (1, k), ``energies`` (1,), ``mismatches`` (1,).
    """
    problem = pair_problem(target, source, group)
    if problem.dim > 3:
        # The eigenfunctions' block follows in closed form from the map that positions and invariants give.
        start = problem.procrustes(match_at_rotation(target, source, start)[0])
    pose = minimise(problem, start[None])
    mismatches, _ = local_evidence(target, source, pose.rotations)
    return {
        "rotations": pose.rotations,
        "maps": pose.maps,
        "energies": pose.energies,
        "mismatches": mismatches,
    }


def solve_again(
    session: AlignSession,
    pairs: Sequence[Pair],
    asked: FloatArray,
    table: SharedTable,
    solve: Callable[..., Solved],
) -> list[Solved]:
    """Return what solving pairs again gives, each from the rotation (E, 3, 3) that the collection asks for."""
    tasks = {
        number: {
            "target": Shared(key=str(pair.target), reader=Samples),
            "source": Shared(key=str(pair.source), reader=Samples),
            "group": session.options.group,
            "start": start,
        }
        for number, (pair, start) in enumerate(zip(pairs, asked, strict=True))
    }
    return list(session.map_parallel("pairs again", solve, tasks, shared=table).values())


def with_common_match(
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    solution: SynchronizationResult,
    rotations: FloatArray,
) -> list[AlignedPair]:
    """Return the pairs with what synchronization says of them, and with their best match at the common poses.

    Parameters
    ----------
    samples : sequence of Samples
    pairs : sequence of Pair
    solution : SynchronizationResult
        Of these pairs.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``, refined and in the final gauge.
    """
    matched = []
    for e, pair in enumerate(pairs):
        point_map, energy = match_at(samples, pair, rotations)
        choice = int(solution.edge_choice[e])
        common = rotations[pair.target].T @ rotations[pair.source]
        settled = {
            "map_target_source": read_only(point_map),
            "energy": energy,
            "choice": choice,
            "inlier": bool(solution.edge_inlier[e]),
            "disagreement_deg": float(rotation_angle_deg(pair.rotations[choice, :3, :3], common)),
        }
        matched.append(AlignedPair(**vars(pair) | settled))
    return matched


def match_at(
    samples: Sequence[Samples], pair: Pair, rotations: FloatArray
) -> tuple[IntArray, float]:
    """Return the best map (k,) of a pair at the common poses (N, 3, 3), and its energy."""
    common = rotations[pair.target].T @ rotations[pair.source]
    return match_at_rotation(samples[pair.target], samples[pair.source], common)
