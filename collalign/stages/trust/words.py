"""What a user must know about the poses, in sentences that name shapes and say what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.confidence.pose_model import symmetric_confidence
from collalign.products.shapes import Constraints
from collalign.products.trust import DOUBT, KINDS, Trust
from collalign.stages.trust.own_turns import turns_in_words
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray, IntArray
from data_tools.percent import listed, percent
from data_tools.poses import APART_DEG, turn_deg
from data_tools.rotations import rotation_angle_deg

#: Collections whose pairs agree this little, on average, say too little.
FEWEST_VOTES = 0.5
#: A pose set by hand that fewer of its pairs than this agree with is contradicted.
CONTRADICTED_VOTES = 0.3


def trust_notes(
    names: Sequence[str],
    trust: Trust,
    confidence: FloatArray,
    first: SynchronizationResult,
    rotations: FloatArray,
    constraints: Constraints,
) -> tuple[str, ...]:
    """Return the sentences about doubtful poses.

    Parameters
    ----------
    names : sequence of str
    trust : Trust
    confidence : ndarray, shape (N,)
    first : SynchronizationResult
        Of the pairs as matched.
    rotations : ndarray, shape (N, 3, 3)
        The reported poses.
    constraints : Constraints
        Poses set by hand, or kept from an earlier run with their whole transforms.
    """
    notes = [
        *_contradicted(names, trust, constraints),
        *_symmetric(trust, confidence),
        *_blocks(names, first, rotations),
    ]
    free = [i for i in range(len(names)) if i not in constraints.fixed]
    doubted = [i for i in free if not confidence[i] >= DOUBT]
    votes = trust.evidence[:, KINDS.index("votes")]
    if doubted and np.nanmean(votes) < FEWEST_VOTES:
        notes.append(
            "Most pairs of shapes contradict the common poses: the shapes may resemble each other too little to be "
            "aligned. Try more points (--sampling.num-points 128) or leave out what is of another kind."
        )
    if doubted:
        order = sorted(doubted, key=lambda i: float(confidence[i]))
        notes.append(
            f"In doubt: {listed([names[i] for i in order])}. The report shows them and offers their other poses."
        )
    return tuple(notes)


def _contradicted(names: Sequence[str], trust: Trust, constraints: Constraints) -> list[str]:
    votes = trust.evidence[:, KINDS.index("votes")]
    return [
        f"{names[i]} {'KEEPS ITS FORMER POSE' if i in constraints.fixed_transforms else 'WAS SET BY HAND'}, AND ITS "
        "PAIRS CONTRADICT IT: few of them ask for this pose. Look at it again."
        for i in sorted(constraints.fixed)
        if votes[i] < CONTRADICTED_VOTES
    ]


def _symmetric(trust: Trust, confidence: FloatArray) -> list[str]:
    """Return the sentence about collections whose shapes look the same in several poses."""
    alike = max(trust.symmetries, key=len)
    if len(alike) < 2:
        return []
    of_part = [len(turns) > 1 for turns in trust.symmetries]
    typical, up_to = (np.nanmedian(chances[of_part]) for chances in (confidence, symmetric_confidence(trust)))
    return [
        f"{sum(of_part)} of {len(of_part)} shapes fit as well in other poses: poses are defined only up to turns "
        f"that leave such shapes as they are, in the common frame {turns_in_words(alike[1:])}. They are right up to "
        f"these turns with a confidence of {percent(up_to)}, absolutely with {percent(typical)} (medians)."
    ]


def _blocks(names: Sequence[str], first: SynchronizationResult, rotations: FloatArray) -> list[str]:
    """Return the sentences about blocks that may be turned as one, where the final poses still have them so."""
    notes, said = [], set[tuple[int, ...]]()
    for cut in first.weak_cuts:
        block = cut.members if 2 * len(cut.members) <= len(names) else _others(cut.members, len(names))
        key = tuple(block.tolist())
        if not cut.doubted or len(block) < 2 or key in said or not _still(first.rotations, rotations, block):
            continue
        said.add(key)
        angle = float(rotation_angle_deg(cut.rotation))
        other = "their mirror image" if np.isnan(angle) else f"a turn of {angle:.0f} deg"
        notes.append(
            f"{listed([names[i] for i in block])} may be turned together against the others: {cut.pairs_for} pairs "
            f"between them speak for the poses as they are, {cut.pairs_against} for {other}. Compare one of them "
            "with one of the others."
        )
    return notes


def _others(members: IntArray, num: int) -> IntArray:
    return np.setdiff1d(np.arange(num), members)


def _still(before: FloatArray, after: FloatArray, block: IntArray) -> bool:
    """Whether most shapes of the block stand to most others as they did before."""
    others = _others(block, len(before))
    was = np.swapaxes(before[block], 1, 2)[:, None] @ before[others][None]
    now = np.swapaxes(after[block], 1, 2)[:, None] @ after[others][None]
    return bool(np.nanmedian(turn_deg(was, now)) <= APART_DEG)
