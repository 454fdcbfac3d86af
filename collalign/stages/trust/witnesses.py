"""Witnesses: the poses that each independent family of evidence asks for by itself, against the reported ones.

Maps and points err for different reasons: a map that takes the top of thin wings for their bottom says so with all of
its measures, and with those of every other pair, so that no cycle shows it. Points know nothing of maps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.confidence.candidate_model import EVIDENCE
from collalign.options import AlignOptions
from collalign.products.pair import Pair
from collalign.products.trust import Witness
from collalign.stages.evidence.weigh import judged_by
from collalign.stages.poses.synchronize import synchronize_pairs
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.notes import Note
from data_tools.poses import APART_DEG, turn_deg

#: Families of evidence that share no measurement, by what they are called in sentences.
FAMILIES = {"points": ("energy", "surface"), "maps": ("curvature", "commutativity", "roughness")}
_OF_MAPS = EVIDENCE.index("commutativity")
#: Turns that are tried between two common frames, at most.
MAX_FRAMES = 100


def hear_witnesses(
    options: AlignOptions, pairs: Sequence[Pair], rotations: FloatArray, components: Sequence[IntArray]
) -> list[Witness]:
    """Synchronize from each family of evidence by itself; there is none where maps were not asked.

    Of 80 bodies, animals and planes of SHREC07 the two named all seven planes that were half turned at .96 to .995,
    one of two birds, and three armadillos that were right.

    Parameters
    ----------
    options : AlignOptions
        With a decided group.
    pairs : sequence of Pair
        As weighed.
    rotations : ndarray, shape (N, 3, 3)
        The reported ``R_common_shape``.
    components : sequence of ndarray of int
        Shapes whose poses can be compared.
    """
    if not any(len(pair.log_odds) and np.isfinite(pair.evidence[:, _OF_MAPS]).any() for pair in pairs):
        return []
    found = []
    for family, kinds in FAMILIES.items():
        heard = [judged_by(pair, kinds) for pair in pairs]
        said = synchronize_pairs(options, len(rotations), heard).rotations
        poses = np.concatenate([_in_frame(said[own], rotations[own]) for own in components])
        poses = poses[np.argsort(np.concatenate(components), kind="stable")]
        apart = np.asarray(turn_deg(poses, rotations)) > APART_DEG
        found.append(Witness(family=family, poses=read_only(poses), contradicts=apart))
    return found


def _in_frame(said: FloatArray, reported: FloatArray) -> FloatArray:
    """Return poses after the turn of the common frame under which most of them are the reported ones."""
    turns = reported @ np.swapaxes(said, 1, 2)
    tried = turns[:: -(-len(turns) // MAX_FRAMES)]
    apart = np.minimum(turn_deg(tried[:, None], turns[None]), APART_DEG)
    return np.asarray(tried[int(np.argmin(apart.sum(axis=1)))] @ said)


def witness_notes(names: Sequence[str], witnesses: Sequence[Witness], rotations: FloatArray) -> list[Note]:
    """Return a note for every witness that contradicts poses.

    Parameters
    ----------
    names : sequence of str
    witnesses : sequence of Witness
    rotations : ndarray, shape (N, 3, 3)
        The reported ones.
    """
    notes = []
    for witness in witnesses:
        against = np.flatnonzero(witness.contradicts)
        if len(against):
            most_deg = float(np.max(turn_deg(witness.poses[against], rotations[against])))
            shapes = tuple(names[i] for i in against.tolist())
            notes.append(Note("evidence-disagrees", shapes, {"family": witness.family, "most_deg": most_deg}))
    return notes
