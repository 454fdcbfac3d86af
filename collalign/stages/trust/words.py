"""What a user must know about the poses, in sentences that name shapes and say what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.confidence.pose_model import resembles_none, symmetric_confidence
from collalign.products.shapes import Constraints
from collalign.products.trust import DOUBT, KINDS, Trust
from collalign.stages.trust.own_turns import turns_in_words
from data_tools.arrays import FloatArray
from data_tools.percent import listed, percent

#: Collections whose pairs agree this little, on average, say too little.
FEWEST_VOTES = 0.5
#: A pose set by hand that fewer of its pairs than this agree with is contradicted.
CONTRADICTED_VOTES = 0.3


def trust_notes(
    names: Sequence[str],
    trust: Trust,
    confidence: FloatArray,
    constraints: Constraints,
) -> tuple[str, ...]:
    """Return the sentences about doubtful poses.

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
        *_strange(names, trust),
        *_symmetric(trust, confidence),
    ]
    free = [i for i in range(len(names)) if i not in {*constraints.by_hand, *constraints.fixed_transforms}]
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
        f"{names[i]} {'WAS SET BY HAND' if i in constraints.by_hand else 'KEEPS ITS FORMER POSE'}, AND ITS "
        "PAIRS CONTRADICT IT: few of them ask for this pose. Look at it again."
        for i in sorted(constraints.fixed)
        if votes[i] < CONTRADICTED_VOTES
    ]


def _strange(names: Sequence[str], trust: Trust) -> list[str]:
    """Return the sentence about shapes that match no other."""
    mismatch = trust.evidence[:, KINDS.index("mismatch")]
    strange = np.flatnonzero(resembles_none(trust.evidence)).tolist()
    if not strange:
        return []
    verb, pronoun = ("resembles", "it") if len(strange) == 1 else ("resemble", "them")
    return [
        f"{listed([names[i] for i in strange])} {verb} no other shape; leave {pronoun} out? The mismatch "
        f"with the most similar shape is {mismatch[strange].min():.2f}, that of the median shape "
        f"{np.nanmedian(mismatch):.2f}; "
        "1 is chance."
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
