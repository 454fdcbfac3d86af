"""From what two surfaces share at a pose to the chance that it is right: a conditional logit with "none is right"."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.poses import pose_angle_deg
from pairwise.features.depth_images import FRONT_UNIT, conflict
from pairwise.features.overlap import LocalPoses

#: Log-odds of a pose per logarithm of what is explained and of consensus, and of "no pose is right", where a line
#: of sight is not known. Explained is 1 / (share of the smaller surface without a partner + 0.1): all of a part
#: lies on its whole. Fitted on depth images and cut shapes.
OVERLAP_WEIGHTS = (2.8, 1.2, -0.6)
UNEXPLAINED = 0.1
#: Log-odds per logarithm of consensus plus the last number, against a pose per unit of conflict with lines of
#: sight, and of "no pose is right", where both surfaces were seen from one direction each. Fitted on depth images.
SIGHT_WEIGHTS = (2.4, 3.1, -8.8, 0.03)
#: Log-odds of a pose of two images of a scene: per mismatch, per logarithm of consensus plus the last number, and of
#: "no pose is right". ``python -m experiments calibrate scenes`` fits them, and says how they do on kinds left out.
SCENE_WEIGHTS = (-1.7, 3.0, -5.5, 0.03)
#: Log-odds of a pose of a part on its whole, and of "no pose is right": per logarithm of 1 / (share of the part off
#: the whole + the last number), of 1 + share of the whole in front of what the part saw over .01, and of the share of
#: the whole that is covered. ``python -m experiments calibrate wholes`` fits them.
WHOLE_WEIGHTS = (2.4, -1.0, 3.5, 1.5, 0.02)
#: Scans that were taken one after the other overlap: by so much their poses are more probable than those of any two.
#: Chosen: if nine of ten of them overlap, and half of all pairs, it is 2.2. On 14 images of a corridor 3 joins alike.
ORDER_ODDS = 2.0
#: A rough pose is right within so many degrees. By so much poses within them are more probable, and others less.
#: Chosen: one in a hundred random rotations is so near, which would be 4.6 if wrong poses were random.
ROUGH_DEG, ROUGH_ODDS = 30.0, 3.0
#: Shares of matches below this count as this: a match more or less says nothing.
LEAST_SHARE = 0.01
#: No pose of a pair is surer than this: what looks alike may not be the same place.
MOST_CERTAIN = 0.99


def overlap_log_odds(poses: LocalPoses, *, of_scene: bool = False) -> FloatArray:
    """Return the log-odds of poses against that none of them is right, shape (p,).

    With lines of sight where both surfaces were seen from one direction each. Of a scene walls and floors overlap at
    wrong poses as well, so that it is what agrees there that counts.
    """
    if of_scene:
        per_mismatch, per_match, none, least = SCENE_WEIGHTS
        return np.asarray(
            per_mismatch * poses.mismatch + per_match * np.log(poses.consensus + least) - none
        )
    of_smaller = -np.log(1.0 - poses.overlaps.max(axis=1, initial=0.0) + UNEXPLAINED)
    unseen = (
        OVERLAP_WEIGHTS[0] * of_smaller
        + OVERLAP_WEIGHTS[1] * np.log(np.maximum(poses.consensus, LEAST_SHARE))
        - OVERLAP_WEIGHTS[2]
    )
    matched = SIGHT_WEIGHTS[0] * np.log(poses.consensus + SIGHT_WEIGHTS[3])
    against = conflict_log_odds(conflict(poses.in_front, poses.beside))
    is_seen = ~np.isnan(poses.in_front).any(axis=1)
    return np.where(is_seen, matched - against - SIGHT_WEIGHTS[2], unseen)


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


def conflict_log_odds(conflicts: FloatArray) -> FloatArray:
    """Return the log-odds against poses that conflict so much with lines of sight, of any shape."""
    return np.asarray(SIGHT_WEIGHTS[1] * conflicts)


def hinted_log_odds(
    rotations: FloatArray, *, in_order: bool, rough: FloatArray | None = None
) -> FloatArray:
    """Return by how much hints make poses of a pair more probable, rotations (p, 3, 3), as log-odds, shape (p,).

    The scans were taken one after the other, if they are ``in_order``; one of the rough rotations (m, 3, 3) is right.
    """
    odds = np.full(len(rotations), ORDER_ODDS if in_order else 0.0)
    if rough is not None:
        is_near = pose_angle_deg(rotations[:, None], rough).min(axis=1) <= ROUGH_DEG
        odds += np.where(is_near, ROUGH_ODDS, -ROUGH_ODDS)
    return odds


def overlap_chances(
    poses: LocalPoses, *, of_scene: bool = False, hinted: FloatArray | float = 0.0
) -> FloatArray:
    """Return how probable each pose is, shape (p,); what they leave is that none is right.

    Hints add their log-odds (p,).
    """
    return chances_of(overlap_log_odds(poses, of_scene=of_scene) + hinted)


def chances_of(odds: FloatArray) -> FloatArray:
    """Return how probable poses of log-odds (p,) against none are, shape (p,)."""
    top = max(float(odds.max(initial=0.0)), 0.0)
    weights = np.exp(odds - top)
    return np.asarray(np.minimum(weights / (weights.sum() + np.exp(-top)), MOST_CERTAIN))
