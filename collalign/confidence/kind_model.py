"""How likely two shapes are of one kind, and how sure it is that two groups of shapes are not.

A conditional statement about one pair is weak: guns of three game packs match each other as badly as birds match
planes. What tells kinds apart is that the nearest kin is far closer than the nearest stranger.
"""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray

#: Log-odds that two shapes are of one kind: a constant, and the weights of the least mismatch of their
#: neighbourhoods at any of their poses, and of the logarithms of two distances that no pose changes
#: (:func:`collalign.stages.kinds.pose_free.kind_descriptors`). A logistic model.
CONSTANT, MISMATCH, SHELLS, DESCRIPTOR = 6.9, -11.6, -1.3, -0.6
#: The same before two shapes are matched: by the two distances alone.
FREE_CONSTANT, FREE_SHELLS, FREE_DESCRIPTOR = -6.4, -2.5, -1.8
#: The same of an open surface and a closed one by their least energy as parts of each other, its logarithm, whatever
#: all else says: what is missing changes both distances, and how whole shapes match. A logistic model; ``python -m
#: experiments calibrate kind_parts`` fits it.
PART_CONSTANT, PART_ENERGY = -12.3, -4.1
#: Distances count as no smaller than this: copies.
LEAST_DISTANCE = 0.02
#: Log-odds that two groups of shapes are of different kinds: a constant, and the weights of two numbers. The first is
#: by how much the nearest kin within both is closer than the nearest shapes across, the second how alike these are. A
#: logistic model of folders of several kinds and of one; ``python -m experiments calibrate kinds`` fits it.
SPLIT_CONSTANT, SPLIT_GAP, SPLIT_ACROSS = -5.1, 2.1, -1.8
#: Groups stay apart from these log-odds on before pairs are matched, where a second look follows.
LEAST_FREE_SPLIT = -3.0
#: Nearest kin counts as no closer than this: copies. A group has to be closer by :data:`FEW` over the members of the
#: smaller one: single shapes may be odd.
MOST_KIN, FEW = 8.0, 2.0


def kin_log_odds(
    shells: FloatArray, descriptors: FloatArray, mismatches: FloatArray | None = None
) -> FloatArray:
    """Return the log-odds that pairs of shapes are of one kind, of the shape of the arguments.

    Parameters
    ----------
    shells, descriptors : ndarray
        Distances of the two descriptors of each pair.
    mismatches : ndarray, optional
        Least mismatch of each pair; without, the distances alone decide.
    """
    logs = (np.log(np.maximum(one, LEAST_DISTANCE)) for one in (shells, descriptors))
    of_shells, of_descriptors = logs
    if mismatches is None:
        return FREE_CONSTANT + FREE_SHELLS * of_shells + FREE_DESCRIPTOR * of_descriptors
    known = CONSTANT + SHELLS * of_shells + DESCRIPTOR * of_descriptors
    return np.asarray(known + MISMATCH * mismatches)


def part_log_odds(energies: FloatArray) -> FloatArray:
    """Return the log-odds that open and closed surfaces are of one kind, of the shape of the argument.

    Parameters
    ----------
    energies : ndarray
        Least of each pair, see :class:`pairwise.partial_match.SearchedPose`.
    """
    return np.asarray(PART_CONSTANT + PART_ENERGY * np.log(energies))


def split_log_odds(gaps: FloatArray, across: FloatArray) -> FloatArray:
    """Return the log-odds that pairs of groups are of different kinds, of the shape of the arguments.

    Parameters
    ----------
    gaps : ndarray
        By how much the nearest kin within both is closer, less what :data:`FEW` asks for.
    across : ndarray
        Mean log-odds of the nearest shapes across.
    """
    return np.asarray(SPLIT_CONSTANT + SPLIT_GAP * gaps + SPLIT_ACROSS * across)
