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
from collalign.products.trust import UNCERTAIN
from collalign.stages.evidence.weigh import weigh_starts, with_candidates, with_evidence
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.stages.trust.rival_poses import MAX_PARTNERS
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
) -> tuple[list[Pair], SynchronizationResult]:
    """Try the rival poses of all shapes against all their partners by maps, until nothing is new.

    The session's group is decided, the pairs are weighed; ``searched`` as for :func:`weigh_starts`. Returned are the
    pairs with the candidates that were found, and their synchronization.
    """
    tried = list(pairs)
    solution = synchronize_pairs(session.options, len(shapes.names), tried)
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
    return tried, solution


def settle_doubtful(
    session: AlignSession, shapes: Shapes, pairs: Sequence[Pair], poses: FloatArray, confidence: FloatArray
) -> list[Pair]:
    """Return the weighed pairs, those of each doubtful shape with the sure ones that match it best weighed anew.

    Their candidates become what the shape's pose and its rivals lead to where surfaces are laid onto each other. Such
    maps rank the right one first in three of four pairs, crude ones in half of them (24 pairs of planes, 42 of
    SCAPE, 54 of humans: this was chosen on them). Poses are ``R_common_shape``, shape (N, 3, 3), confidences (N,).
    """
    near: dict[int, list[tuple[float, int]]] = {}
    for e, pair in enumerate(pairs):
        for own, other in ((pair.target, pair.source), (pair.source, pair.target)):
            if confidence[own] < UNCERTAIN <= confidence[other]:
                near.setdefault(own, []).append((float(pair.energies.min()), e))
    votes = votes_of(pairs, poses)
    starts = {
        e: _asked_of(pairs[e], poses, own, voted_poses(votes[own], poses[own]))
        for own, ranked in near.items()
        for _, e in sorted(ranked)[:MAX_PARTNERS]
    }
    found = weigh_starts(session, shapes, pairs, starts, is_first=False, searched=True) if starts else {}
    return [with_evidence(pair, found[e]) if e in found else pair for e, pair in enumerate(pairs)]


def missing_poses(pairs: Sequence[Pair], poses: FloatArray) -> dict[int, FloatArray]:
    """Return the rotations (m, 3, 3) that poses and rivals ask for and a pair has no candidate near, by pair.

    Poses are ``R_common_shape``, shape (N, 3, 3).
    """
    rivals = [voted_poses(votes, pose) for votes, pose in zip(votes_of(pairs, poses), poses, strict=True)]
    asked = {}
    for e, pair in enumerate(pairs):
        fresh: list[FloatArray] = []
        for pose in np.concatenate([_asked_of(pair, poses, own, rivals[own]) for own in (pair.target, pair.source)]):
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


def _asked_of(pair: Pair, poses: FloatArray, own: int, rivals: FloatArray) -> FloatArray:
    """Return the relative rotations of a pair at which one of its shapes has each of some poses (m, 3, 3)."""
    return np.swapaxes(rivals, 1, 2) @ poses[pair.source] if own == pair.target else poses[pair.target].T @ rivals


def _is_known(pair: Pair, pose: FloatArray, angle_deg: float) -> bool:
    """Whether a candidate of a pair that takes part is near a rotation."""
    return _is_near(list(pair.rotations[np.isfinite(pair.log_odds), :3, :3]), pose, angle_deg)


def _is_near(known: Sequence[FloatArray], pose: FloatArray, angle_deg: float) -> bool:
    return any(turn_deg(other, pose) <= angle_deg for other in known)
