"""What a user must know about the poses: notes that name shapes, and what to try where most are in doubt."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from collalign.confidence.pose_model import resembles_none, symmetric_confidence
from collalign.options import AUTO, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Constraints, Shapes
from collalign.products.trust import DOUBT, MISMATCH, VOTES, Trust
from collalign.stages.poses.synchronize import pair_graph
from collalign.stages.trust.rival_poses import describe_rotations
from collalign.synchronization.clusters import pair_affinity, spectral_clusters
from data_tools.arrays import BoolArray, FloatArray
from data_tools.notes import MAX_NAMED, Note, listed
from data_tools.surface.cleaning import share_kept

#: Collections whose pairs agree this little, on average, say too little.
FEWEST_VOTES = 0.5
#: A pose that fewer of its pairs than this agree with is contradicted.
CONTRADICTED_VOTES = 0.3
#: Folders of which at least this share is in doubt may hold several kinds of shapes, ...
MOST_IN_DOUBT = 0.5
#: ... where pairs across the parts that agree among themselves match so many times worse than those within.
WORSE_ACROSS = 1.5
#: Shapes below this confidence may be incomplete; above it a rival pose is the likelier reason.
MAY_BE_CUT = 0.7


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


def remedies(
    session: AlignSession,
    shapes: Shapes,
    pairs: Sequence[Pair],
    confidence: FloatArray,
    strange: BoolArray,
) -> list[Note]:
    """Return notes that name the option which helps where most shapes, or open surfaces, are in doubt.

    Parameters
    ----------
    session : Session
        With a decided group.
    shapes : Shapes
    pairs : sequence of Pair
        As first matched.
    confidence : ndarray, shape (N,)
    strange : ndarray of bool, shape (N,)
        Shapes that resemble no other one: they are of another kind, not incomplete.
    """
    options, said = session.options, []
    in_doubt = np.flatnonzero(~(confidence >= DOUBT))
    mostly = len(in_doubt) >= MOST_IN_DOUBT * len(confidence)
    kinds = _kinds(pairs, len(confidence), options.group) if mostly else []
    if kinds:
        groups = "; ".join(listed([shapes.names[i] for i in kind]) for kind in kinds)
        said.append(Note("several-kinds", values={"num": len(kinds), "groups": groups}))
    elif options.incomplete == AUTO:
        may_be_cut = [i for i in _doubted(confidence) if not strange[i]][:MAX_NAMED]
        cut = [
            shapes.names[i]
            for i in may_be_cut
            if shapes.samples[i].may_be_cut and not shapes.samples[i].is_poor
        ]
        if cut:
            said.append(Note("open-borders", tuple(cut)))
    said += components_left_out(shapes, in_doubt.tolist())
    return said


def components_left_out(shapes: Shapes, in_doubt: Iterable[int]) -> list[Note]:
    """Return the note that names those of some shapes which lost components when they were read, if there are any."""
    lost = [i for i in in_doubt if round(share_kept(shapes.samples[i].notes), 2) < 1]
    return [Note("components-left-out", tuple(shapes.names[i] for i in lost))] if lost else []


def _doubted(confidence: FloatArray) -> list[int]:
    return [i for i in np.argsort(confidence, kind="stable").tolist() if confidence[i] < MAY_BE_CUT]


def _kinds(pairs: Sequence[Pair], num: int, group: str) -> list[list[int]]:
    """Return the parts of shapes whose pairs agree, where those between them match much worse; none otherwise."""
    labels = spectral_clusters(pair_affinity(pair_graph(pairs, num, group)), None)
    energies = np.array([pair.energies.min() for pair in pairs])
    across = np.array([labels[pair.target] != labels[pair.source] for pair in pairs])
    if (
        not across.any()
        or across.all()
        or np.median(energies[across]) < WORSE_ACROSS * np.median(energies[~across])
    ):
        return []
    return [np.flatnonzero(labels == part).tolist() for part in range(labels.max() + 1)]
