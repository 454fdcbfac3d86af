"""From what two surfaces share at a pose to the chance that it is right: a conditional logit with "none is right"."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.poses import pose_angle_deg
from pairwise.features.depth_images import FRONT_UNIT, conflict
from pairwise.features.overlap import LocalPoses

#: Log-odds of a pose against that none of a pair is right, per unit of what :func:`known_evidence` returns. Columns
#: are consensus, what is explained, how unlike that is, conflict with what was seen, and a constant. Rows are for
#: surfaces that were not seen from one side, along parallel rays, and from one place. Fitted by ``python -m
#: experiments calibrate overlaps``.
OVERLAP_WEIGHTS = (
    (1.7, 1.9, 0.0, 0.0, 1.7),
    (0.9, 2.2, 0.0, -2.6, 4.6),
    (1.9, 2.5, -6.8, -4.4, 8.7),
)
#: The column of conflicts, and the row of scenes, which were seen from one place each.
CONFLICT, SCENES = 3, 2
#: Added to consensus and to the smaller overlap before their logarithms are taken, and to shares with or without a
#: partner where they divide or their logarithms are taken.
LEAST_CONSENSUS, UNEXPLAINED = 0.03, 0.1
#: Log-odds of a pose of a part on its whole, and of "no pose is right": per logarithm of 1 / (share of the part off
#: the whole + the last number), of 1 + share of the whole in front of what the part saw over .01, and of the share of
#: the whole that is covered. ``python -m experiments calibrate wholes`` fits them.
WHOLE_WEIGHTS = (2.5, -0.8, 5.0, 4.8, 0.02)
#: Scans that were taken one after the other overlap: by so much their poses are more probable than those of any two.
#: ``python -m experiments calibrate overlaps`` fits this and the next two numbers.
ORDER_ODDS = 2.5
#: A rough pose is right within so many degrees. By so much poses within them are more probable, and others less.
ROUGH_DEG, ROUGH_ODDS = 30.0, 3.2
#: So much of an image of a scene is in front of what another one saw where joined poses are right, at most: these and
#: the place of a camera are off.
HARMLESS = 0.017
#: Shares of matches below this count as this: a match more or less says nothing.
LEAST_SHARE = 0.01
#: No pose of a pair is surer than this: what looks alike may not be the same place.
MOST_CERTAIN = 0.99


def overlap_log_odds(poses: LocalPoses) -> FloatArray:
    """Return the log-odds of poses against that none of them is right, shape (p,)."""
    weights = np.array(OVERLAP_WEIGHTS)[_row(poses.in_front, poses.beside)]
    return np.asarray((weights * known_evidence(poses)).sum(axis=1))


def known_evidence(poses: LocalPoses) -> FloatArray:
    """Return what a row of :data:`OVERLAP_WEIGHTS` weighs, shape (p, 5); 0 is what is not known."""
    row, overlaps = _row(poses.in_front, poses.beside), poses.overlaps
    is_scene, shared = row == SCENES, overlaps.mean(axis=1)
    # All of a part may lie on its whole. In rooms, walls lie on walls at many places: both images must share much
    # there, and what they share must be alike.
    explained = -np.log(1.0 - overlaps.max(axis=1, initial=0.0) + UNEXPLAINED)
    both = np.log(overlaps.min(axis=1, initial=1.0) + LEAST_CONSENSUS)
    unlike = (poses.mismatch - (1.0 - shared)) / (shared + UNEXPLAINED)
    columns = (
        np.log(poses.consensus + LEAST_CONSENSUS),
        np.where(is_scene, both, explained),
        np.where(is_scene, unlike, 0.0),
        np.where(row > 0, _conflict(poses.in_front, poses.beside), 0.0),
        np.ones(len(poses)),
    )
    return np.column_stack(columns)


def overlap_evidence(poses: LocalPoses) -> FloatArray:
    """Return what all :data:`OVERLAP_WEIGHTS` weigh, shape (p, 15): 0 in other rows than that of a pose."""
    found = np.zeros((len(poses), *np.shape(OVERLAP_WEIGHTS)))
    found[np.arange(len(poses)), _row(poses.in_front, poses.beside)] = known_evidence(poses)
    return found.reshape(len(poses), -1)


def _conflict(in_front: FloatArray, beside: FloatArray) -> FloatArray:
    """Return how shares (p, 2) contradict poses, shape (p,): of scenes what is in front of either image."""
    either = np.log1p(np.nan_to_num(in_front) / FRONT_UNIT).sum(axis=1)
    return np.where(_row(in_front, beside) == SCENES, either, conflict(in_front, beside))


def _row(in_front: FloatArray, beside: FloatArray) -> IntArray:
    """Return the row of :data:`OVERLAP_WEIGHTS` by which shares (p, 2) are known of both surfaces, shape (p,).

    Of two images of a scene the place of one tells.
    """
    knows_front, knows_beside = ~np.isnan(in_front), ~np.isnan(beside)
    is_scene = knows_front.any(axis=1) & ~knows_beside.any(axis=1)
    is_parallel = knows_front.all(axis=1) & knows_beside.all(axis=1)
    return np.where(is_scene, SCENES, np.where(is_parallel, 1, 0))


def on_whole_log_odds(poses: LocalPoses) -> FloatArray:
    """Return the log-odds of poses of a part on its whole against that none of them is right, shape (p,)."""
    *weights, least = WHOLE_WEIGHTS
    return on_whole_evidence(poses, least) @ np.array(weights)


def on_whole_evidence(poses: LocalPoses, least: float) -> FloatArray:
    """Return what the first four of :data:`WHOLE_WEIGHTS` weigh, shape (p, 4)."""
    in_front = np.nan_to_num(poses.in_front[:, 0])
    columns = (
        -np.log(1.0 - poses.overlaps[:, 1] + least),
        np.log1p(in_front / FRONT_UNIT),
        np.log(np.maximum(poses.overlaps[:, 0], LEAST_SHARE)),
        np.ones(len(poses)),
    )
    return np.column_stack(columns)


def conflict_log_odds(in_front: FloatArray, beside: FloatArray) -> FloatArray:
    """Return the log-odds against poses that conflict so much with what was seen, shares (p, 2), shape (p,).

    Up to :data:`HARMLESS` in front contradict nothing.
    """
    weights = np.array(OVERLAP_WEIGHTS)[_row(in_front, beside), CONFLICT]
    return np.asarray(-weights * _conflict(np.maximum(in_front - HARMLESS, 0.0), beside))


def hinted_log_odds(
    rotations: FloatArray, *, in_order: bool, rough: FloatArray | None = None
) -> FloatArray:
    """Return by how much hints make poses of a pair more probable, rotations (p, 3, 3), as log-odds, shape (p,).

    The scans were taken one after the other, if they are ``in_order``; one of the rough rotations (m, 3, 3) is right.
    """
    return hinted_evidence(rotations, in_order=in_order, rough=rough) @ [ORDER_ODDS, ROUGH_ODDS]


def hinted_evidence(
    rotations: FloatArray, *, in_order: bool, rough: FloatArray | None = None
) -> FloatArray:
    """Return what :data:`ORDER_ODDS` and :data:`ROUGH_ODDS` weigh, shape (p, 2)."""
    found = np.zeros((len(rotations), 2))
    found[:, 0] = in_order
    if rough is not None:
        is_near = pose_angle_deg(rotations[:, None], rough).min(axis=1) <= ROUGH_DEG
        found[:, 1] = np.where(is_near, 1.0, -1.0)
    return found


def chances_of(odds: FloatArray) -> FloatArray:
    """Return how probable poses of log-odds (p,) against none are, shape (p,)."""
    top = max(float(odds.max(initial=0.0)), 0.0)
    weights = np.exp(odds - top)
    return np.asarray(np.minimum(weights / (weights.sum() + np.exp(-top)), MOST_CERTAIN))
