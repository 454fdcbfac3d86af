"""What a user must know about the poses: notes that name shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.confidence.pose_model import resembles_none, symmetric_confidence
from collalign.products.shapes import Constraints
from collalign.products.trust import DOUBT, MISMATCH, VOTES, Trust
from collalign.stages.trust.near_symmetry import describe_rotations
from data_tools.arrays import FloatArray
from data_tools.notes import Note

#: Collections whose pairs agree this little, on average, say too little.
FEWEST_VOTES = 0.5
#: A pose that fewer of its pairs than this agree with is contradicted.
CONTRADICTED_VOTES = 0.3


def trust_notes(
    names: Sequence[str],
    trust: Trust,
    confidence: FloatArray,
    constraints: Constraints,
) -> tuple[Note, ...]:
    """Return the notes about doubtful poses.

    Parameters
    ----------
    names : sequence of str
    trust : Trust
    confidence : ndarray, shape (N,)
    constraints : Constraints
        Poses set by hand, or kept from an earlier run with their whole transforms.
    """
    notes = [
        *_contradicted(names, trust, constraints),
        *strange_note(names, trust, np.flatnonzero(resembles_none(trust.evidence)).tolist()),
        *_symmetric(trust, confidence),
    ]
    free = [
        i
        for i in range(len(names))
        if i not in {*constraints.by_hand, *constraints.fixed_transforms}
    ]
    doubted = [i for i in free if not confidence[i] >= DOUBT]
    votes = trust.evidence[:, VOTES]
    if doubted and np.nanmean(votes) < FEWEST_VOTES:
        notes.append(Note("most-pairs-disagree"))
    if doubted:
        order = sorted(doubted, key=lambda i: float(confidence[i]))
        notes.append(Note("doubtful", tuple(names[i] for i in order)))
    return tuple(notes)


def _contradicted(names: Sequence[str], trust: Trust, constraints: Constraints) -> list[Note]:
    votes = trust.evidence[:, VOTES]
    return [
        Note(
            "contradicted-by-hand" if i in constraints.by_hand else "contradicted-kept", (names[i],)
        )
        for i in sorted(constraints.fixed)
        if votes[i] < CONTRADICTED_VOTES
    ]


def strange_note(names: Sequence[str], trust: Trust, strange: Sequence[int]) -> list[Note]:
    """Return the note about shapes that match no other, if there are any."""
    mismatch = trust.evidence[:, MISMATCH]
    if not strange:
        return []
    numbers = {"mismatch": float(mismatch[strange].min()), "median": float(np.nanmedian(mismatch))}
    return [Note("resembles-none", tuple(names[i] for i in strange), numbers)]


def _symmetric(trust: Trust, confidence: FloatArray) -> list[Note]:
    """Return the note about collections whose shapes look the same in several poses."""
    alike = max(trust.symmetries, key=len)
    if len(alike) < 2:
        return []
    of_part = [len(turns) > 1 for turns in trust.symmetries]
    absolute, up_to = (
        float(np.nanmedian(of[of_part])) for of in (confidence, symmetric_confidence(trust))
    )
    numbers = {"num": sum(of_part), "total": len(of_part), "up_to": up_to, "absolute": absolute}
    return [Note("symmetric", values={**numbers, "rotations": describe_rotations(alike[1:])})]
