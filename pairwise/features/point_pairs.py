"""Poses of a part on a whole by votes of pairs of oriented points (Drost, Ulrich, Navab and Ilic, CVPR 2010).

Two points with normals say how far apart they are and how their normals and their connection meet. Descriptors of
neighbourhoods change where a part ends, and are alike all over a plate; pairs are not. Every pair of the whole that
looks like one of the part votes for the pose that brings one to the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.local_surface import LocalSurface


class VoteTuning(NamedTuple):
    """Numbers of the votes.

    Chosen on 24 scans of eight objects. References and places are chosen on 72 scans of twelve other generated
    models: with 40 and 4 the right pose is among the last ones for 62, with 80 and 4 for 63, with 80 and 8 for 66.
    """

    num_whole: int = 500
    """Points of the whole, at most, ..."""
    num_part: int = 150
    """... of the part, ..."""
    num_references: int = 80
    """... and those of the part each of which looks for its place."""
    num_places: int = 8
    """Places that each proposes."""
    step_cells: float = 2.0
    """Pairs nearer than this are too near to say anything; farther ones are alike within a step of it."""
    num_angles: int = 12
    """Steps of the three angles of a pair."""
    num_turns: int = 24
    """Steps of the turn around a normal."""


#: The numbers in use.
TUNED = VoteTuning()
_TINY = float(np.finfo(float).tiny)


class _Pairs(NamedTuple):
    """First and second points of pairs, which are alike, and the turn of the second about the first's normal."""

    first: IntArray
    second: IntArray
    keys: IntArray
    turns: FloatArray


def pair_vote_poses(
    whole: LocalSurface, part: LocalSurface
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rigid poses of a part on a whole, rotations (p, 3, 3), shifts (p, 3), and their votes (p,).

    Parameters
    ----------
    whole, part : LocalSurface
        In one unit of length, with cells of about the same size.
    """
    from pairwise.features.votes import counted_votes, most_voted

    cell = max(whole.cell, part.cell)
    to, of = whole.few(TUNED.num_whole), part.few(TUNED.num_part)
    places, normals = whole.points[to], whole.normals[to]
    points, directions = part.points[of], part.normals[of]
    references = np.arange(0, len(points), -(-len(points) // TUNED.num_references))
    span = float(np.linalg.norm(np.ptp(points, axis=0)))
    frames, own_frames = _frames(normals), _frames(directions)
    reach = span + TUNED.step_cells * cell
    theirs = _pairs(places, normals, frames, np.arange(len(places)), cell, reach)
    own = _pairs(points, directions, own_frames, references, cell, reach)
    order = np.argsort(theirs.keys, kind="stable")
    starts, ends = (
        np.searchsorted(theirs.keys[order], own.keys, side) for side in ("left", "right")
    )
    own_votes, own_turns = counted_votes(
        (starts, ends, order),
        (own.first, theirs.first),
        (own.turns, theirs.turns),
        (len(references), len(places), TUNED.num_turns),
    )
    # A step counts its neighbours by half, and turns by the mean of all that vote for it.
    before, after = (np.roll(own_votes, by, axis=2) for by in (1, -1))
    votes = own_votes + 0.5 * (before + after)
    turned = np.roll(own_turns, 1, axis=2) - before + np.roll(own_turns, -1, axis=2) + after
    flat = votes.reshape(len(references), -1)
    means = (own_turns + 0.5 * turned).reshape(flat.shape) / np.maximum(flat, _TINY)
    best = most_voted(flat, TUNED.num_places)
    place, step = np.divmod(best.ravel(), TUNED.num_turns)
    reference = np.repeat(references, best.shape[1])
    steps = step + np.take_along_axis(means, best, axis=1).ravel()
    about = _about_first(steps / TUNED.num_turns * 2.0 * np.pi)
    rotations = np.swapaxes(frames[place], 1, 2) @ about @ own_frames[reference]
    shifts = places[place] - (rotations @ points[reference][:, :, None])[:, :, 0]
    return rotations, shifts, np.asarray(np.take_along_axis(flat, best, axis=1).ravel())


def _pairs(
    points: FloatArray,
    normals: FloatArray,
    frames: FloatArray,
    references: IntArray,
    cell: float,
    reach: float,
) -> _Pairs:
    """Return the pairs of each reference and each point, within reach and not too near."""
    arms = points[None] - points[references][:, None]
    lengths = np.linalg.norm(arms, axis=2)
    row, second = np.nonzero((lengths > TUNED.step_cells * cell) & (lengths < reach))
    first, arms, lengths = references[row], arms[row, second], lengths[row, second]
    directions = arms / lengths[:, None]
    keys = np.floor(lengths / (TUNED.step_cells * cell)).astype(np.int64)
    for one, other in (
        (normals[first], directions),
        (normals[second], directions),
        (normals[first], normals[second]),
    ):
        angles = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0)) / np.pi
        steps = np.minimum((angles * TUNED.num_angles).astype(np.int64), TUNED.num_angles - 1)
        keys = keys * TUNED.num_angles + steps
    across = (frames[first] @ arms[:, :, None])[:, :, 0]
    turns = np.arctan2(across[:, 2], across[:, 1])
    return _Pairs(first=row, second=second, keys=keys, turns=turns)


def _frames(normals: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) that take each normal to the first axis."""
    axes = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    second = np.cross(normals, axes)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([normals, second, np.cross(normals, second)], axis=1)


def _about_first(angles: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) about the first axis."""
    rotations = np.zeros((len(angles), 3, 3))
    rotations[:, 0, 0] = 1.0
    rotations[:, 1, 1] = rotations[:, 2, 2] = np.cos(angles)
    rotations[:, 2, 1] = np.sin(angles)
    rotations[:, 1, 2] = -rotations[:, 2, 1]
    return rotations
