"""Shapes in doubt: their rival poses, which their pairs vote for, are weighed anew by better maps.

Maps on few samples (:mod:`collalign.stages.evidence.weigh`) may mislead most pairs of a shape alike, and then no
synchronization can tell. Where surfaces are laid onto each other, the right pose is first in more of the pairs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from collalign.options import AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.products.trust import UNCERTAIN
from collalign.stages.evidence.weigh import weigh_starts, with_evidence
from collalign.stages.trust.rival_poses import MAX_PARTNERS
from data_tools.arrays import FloatArray
from data_tools.poses import keep_apart

#: Poses of a shape within this angle are one rival, and how many are tried beside the present pose.
SAME_RIVAL_DEG, NUM_RIVALS = 25.0, 3

#: What the pairs of one shape say about its pose in the common frame: poses (v, 3, 3), and the probability of each
#: candidate by its pair alone (v,).
Votes: TypeAlias = tuple[FloatArray, FloatArray]


def weigh_doubtful_pairs(
    session: AlignSession,
    shapes: Shapes,
    pairs: Sequence[Pair],
    poses: FloatArray,
    confidence: FloatArray,
) -> list[Pair]:
    """Return the weighed pairs, those of each doubtful shape with the sure ones that match it best weighed anew.

    Their candidates become what the shape's pose and its rivals lead to where surfaces are laid onto each other. The
    right one is first in 184 of 228 such pairs of five classes, on which this was chosen, 147 by crude maps and 178
    by a full search. Poses are ``R_common_shape``, shape (N, 3, 3), confidences (N,).
    """
    near: dict[int, list[tuple[float, int]]] = {}
    for e, pair in enumerate(pairs):
        for own, other in ((pair.target, pair.source), (pair.source, pair.target)):
            if confidence[own] < UNCERTAIN <= confidence[other]:
                near.setdefault(own, []).append((float(pair.energies.min()), e))
    votes = votes_of(pairs, poses)
    starts: dict[int, FloatArray] = {}
    for own, ranked in near.items():
        rivals = voted_poses(votes[own], poses[own])
        for _, e in sorted(ranked)[:MAX_PARTNERS]:
            i, j = pairs[e].target, pairs[e].source
            starts[e] = np.swapaxes(rivals, 1, 2) @ poses[j] if own == i else poses[i].T @ rivals
    found = (
        weigh_starts(session, shapes, pairs, starts, is_first=False, searched=True)
        if starts
        else {}
    )
    return [with_evidence(pair, found[e]) if e in found else pair for e, pair in enumerate(pairs)]


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
