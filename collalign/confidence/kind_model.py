"""How likely two shapes are of one kind, and how sure it is that two groups of shapes are not.

A conditional statement about one pair is weak: guns of three game packs match each other as badly as birds match
planes. What tells kinds apart is that the nearest kin is far closer than the nearest stranger.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray

#: Log-odds that two matched shapes are of one kind: a constant, and the weights of the least mismatch of their
#: neighbourhoods at any of their poses, and of the logarithms of the least energy and of two distances that no pose
#: changes (:func:`collalign.stages.kinds.pose_free.kind_descriptors`). A conditional logit of which shapes are kin of
#: each, of 33 kinds of equal weight: SHREC07, CAPOD, seats and guns of game packs, and generated objects. The command
#: ``python -m experiments calibrate kinds`` fits them again, also without each kind.
CONSTANT, MISMATCH, ENERGY, SHELLS, INVARIANTS = 1.4, -11.3, -1.8, -0.6, -1.2
#: The same before two shapes are matched: by two distances alone.
FREE_CONSTANT, FREE_SHELLS, FREE_DESCRIPTOR = -13.9, -4.0, -2.6
#: Distances and energies count as no smaller than this: copies.
LEAST = 0.02
#: Two groups are of different kinds only if the log-odds of their nearest members are below this on average, ...
MOST_ALIKE = 1.0
#: ... and the mean log-odds of the nearest kin within each are above those by this, and by :data:`FEW` over the
#: members of the smaller group: single shapes may be odd.
LEAST_GAP, FEW = 5.8, 2.0
#: What the log-odds of the nearest kin of a single shape count as, which nobody knows.
LONE_KIN = 1.5
#: The same before pairs are matched, where a second look follows.
LEAST_FREE_GAP = 1.0
#: The odds that two groups are of different kinds: even at a gap of :data:`EVEN_GAP`, and e times as much for each
#: unit of :data:`UNIT_GAP`.
EVEN_GAP, UNIT_GAP = 4.4, 0.9


def free_log_odds(shells: FloatArray, descriptors: FloatArray) -> FloatArray:
    """Return the log-odds that pairs of shapes are of one kind before they are matched, of the arguments' shape.

    Parameters
    ----------
    shells, descriptors : ndarray
        Distances of two descriptors of each pair.
    """
    logs = FREE_SHELLS * log_of(shells) + FREE_DESCRIPTOR * log_of(descriptors)
    return np.asarray(FREE_CONSTANT + logs)


def kin_log_odds(
    shells: FloatArray, invariants: FloatArray, mismatches: FloatArray, energies: FloatArray
) -> FloatArray:
    """Return the log-odds that matched pairs of shapes are of one kind, of the shape of the arguments.

    Parameters
    ----------
    shells, invariants : ndarray
        Distances of two descriptors of each pair.
    mismatches, energies : ndarray
        The least of the poses of each pair.
    """
    logs = SHELLS * log_of(shells) + INVARIANTS * log_of(invariants) + ENERGY * log_of(energies)
    return np.asarray(CONSTANT + MISMATCH * mismatches + logs)


def log_of(values: FloatArray) -> FloatArray:
    """Return the logarithm of distances or energies, which count as no less than :data:`LEAST`."""
    return np.asarray(np.log(np.maximum(values, LEAST)))


def split_confidence(gap: float) -> float:
    """Return how likely two groups with this gap, less what :data:`FEW` asks for, are of different kinds."""
    return float(1.0 / (1.0 + np.exp(-(gap - EVEN_GAP) / UNIT_GAP)))
