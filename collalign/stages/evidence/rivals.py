"""The collection asks back: rival poses of every shape are tried against all its partners, until nothing is new.

A pair alone proposes the poses that it can find. The other pairs of a shape may agree on a pose that a pair never
tried; then its maps are started there, and what they say counts as much as what the pair found first. Every rival is
tried against all partners, the wrong ones like the right one, so that none is favoured by being asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from collalign.options import MAX_ROUNDS, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.evidence.weigh import weigh_starts, with_candidates
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray
from data_tools.poses import SAME_DEG, keep_apart, turn_deg

#: Poses of a shape within this angle are one rival, and how many are tried beside the present pose.
SAME_RIVAL_DEG, NUM_RIVALS = 25.0, 3


#: What the pairs of one shape say about its pose in the common frame: poses (v, 3, 3), and the probability of each
#: candidate by its pair alone (v,).
Votes: TypeAlias = tuple[FloatArray, FloatArray]


def try_rivals(
    session: AlignSession, shapes: Shapes, pairs: Sequence[Pair], *, searched: bool
) -> tuple[list[Pair], SynchronizationResult, float]:
    """Try the rival poses of all shapes against all their partners by maps, until nothing is new.

    The session's group is decided, the pairs are weighed; ``searched`` as for :func:`weigh_starts`.

    Returns
    -------
    pairs : list of Pair
        With the candidates that were found.
    solution : SynchronizationResult
        Of these pairs.
    gain : float
        Log-odds, summed over the pairs, of its poses against those of the first synchronization.
    """
    tried = list(pairs)
    first = solution = synchronize_pairs(session.options, len(shapes.names), tried)
    for _ in range(MAX_ROUNDS):
        starts = missing_poses(tried, solution.rotations)
        grown = False
        weighed = weigh_starts(session, shapes, tried, starts, is_first=False, searched=searched) if starts else {}
        for e, found in weighed.items():
            known = [_is_known(tried[e], rotation, SAME_DEG) for rotation in found.rotations]
            fresh = [pose for pose, is_known in enumerate(known) if not is_known]
            if fresh:
                tried[e], grown = with_candidates(tried[e], found.some(fresh)), True
        if not grown:
            break
        solution = synchronize_pairs(session.options, len(shapes.names), tried)
    return tried, solution, support(tried, solution.rotations) - support(tried, first.rotations)


def support(pairs: Sequence[Pair], poses: FloatArray) -> float:
    """Return the log-odds of some poses, summed over the pairs.

    Of each pair counts the likeliest candidate near the poses; where there is none, its least likely one.

    Parameters
    ----------
    pairs : sequence of Pair
        Weighed.
    poses : ndarray, shape (N, 3, 3)
    """
    total = 0.0
    for pair in pairs:
        able = np.isfinite(pair.log_odds)
        near = turn_deg(pair.rotations[able, :3, :3], poses[pair.target].T @ poses[pair.source]) <= SAME_RIVAL_DEG
        odds = pair.log_odds[able]
        total += float(odds[near].max() if near.any() else odds.min())
    return total


def missing_poses(pairs: Sequence[Pair], poses: FloatArray) -> dict[int, FloatArray]:
    """Return the relative rotations that the shapes' poses and rivals ask for and a pair has no candidate near.

    Parameters
    ----------
    pairs : sequence of Pair
    poses : ndarray, shape (N, 3, 3)
        ``R_common_shape``.

    Returns
    -------
    dict of int to ndarray (m, 3, 3)
        By position of the pair.
    """
    rivals = [voted_poses(votes, pose) for votes, pose in zip(votes_of(pairs, poses), poses, strict=True)]
    asked = {}
    for e, pair in enumerate(pairs):
        of_target = np.swapaxes(rivals[pair.target], 1, 2) @ poses[pair.source]
        of_source = poses[pair.target].T @ rivals[pair.source]
        fresh: list[FloatArray] = []
        for pose in np.concatenate([of_target, of_source]):
            if not _is_known(pair, pose, SAME_RIVAL_DEG) and not _is_near(fresh, pose, SAME_RIVAL_DEG):
                fresh.append(pose)
        if fresh:
            asked[e] = np.stack(fresh)
    return asked


def votes_of(pairs: Sequence[Pair], poses: FloatArray) -> list[Votes]:
    """Return what the pairs' candidates say about every shape, given the poses of their other shapes."""
    found: list[list[Votes]] = [[] for _ in poses]
    for pair in pairs:
        chance = np.exp(pair.log_odds - pair.log_odds.max())
        chance /= chance.sum()
        relative = pair.rotations[:, :3, :3]
        found[pair.target].append((poses[pair.source] @ np.swapaxes(relative, 1, 2), chance))
        found[pair.source].append((poses[pair.target] @ relative, chance))
    return [
        (
            np.concatenate([votes for votes, _ in own] or [np.empty((0, 3, 3))]),
            np.concatenate([weights for _, weights in own] or [np.empty(0)]),
        )
        for own in found
    ]


def voted_poses(votes: Votes, pose: FloatArray) -> FloatArray:
    """Return the pose of a shape and the strongest other ones that its pairs vote for, shape (at most 4, 3, 3)."""
    voted, weights = votes
    flat = voted.reshape(-1, 9)
    close = 1.0 + 2.0 * np.cos(np.deg2rad(SAME_RIVAL_DEG))
    near = flat @ flat.T >= close
    support = near @ weights
    ranked = np.concatenate([pose[None], voted[np.argsort(-support, kind="stable")]])
    return ranked[keep_apart(ranked, SAME_RIVAL_DEG, num=NUM_RIVALS + 1)]


def _is_known(pair: Pair, pose: FloatArray, angle_deg: float) -> bool:
    """Whether a candidate of a pair that takes part is near a rotation."""
    return _is_near(list(pair.rotations[np.isfinite(pair.log_odds), :3, :3]), pose, angle_deg)


def _is_near(known: Sequence[FloatArray], pose: FloatArray, angle_deg: float) -> bool:
    return any(turn_deg(other, pose) <= angle_deg for other in known)
