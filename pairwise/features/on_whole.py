"""Poses of a part, such as a scan, on the whole that it was taken from: everything of the part lies on it.

Poses are found between points one cell apart. They are refined and compared between finer ones, since a smooth or
flat part lies within a cell of its whole at many wrong poses, too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from data_tools.arrays import FloatArray, read_only
from data_tools.checks import check_choice
from data_tools.local_surface import LocalSurface
from data_tools.poses import Similarity
from data_tools.threads import one_blas_thread
from pairwise.features.depth_images import sight_conflicts
from pairwise.features.overlap import (
    PARTNER_CELLS,
    PARTNER_COSINE,
    LocalPoses,
    closeness,
    evaluate_poses,
)
from pairwise.features.point_pairs import pair_vote_poses
from pairwise.features.poses import (
    FIRST_STEPS,
    LAST_STEPS,
    STEP_COSINE,
    consensus_poses,
    feature_distances,
    match_features,
    poses_apart,
    refine_on_planes,
    rotations_by,
)

#: A part is no larger than so many times its whole, by root mean square radii: what is, is in another unit. Even the
#: two ends of a dumbbell are below two.
MOST_LARGER = 3.0
#: Poses that pairs of points propose are looked at by so many points of the part, within so many cells of the whole.
LOOKED_POINTS, LOOKED_CELLS = 80, 2.0
#: So many of them are refined, by so many points, that differ by more than these degrees or cells ...
NUM_PROPOSED, PROPOSED_POINTS, SAME_PROPOSED = 150, 100, (10.0, 2.5)
#: ... and of which so many for each wanted one, by so many points, are refined on all points.
NUM_KEPT, FEW_POINTS = 2, 200
#: How much a share of the whole in front of what the part saw counts against a pose, beside the share of the part
#: that lies on the whole. Chosen on the scans of :class:`pairwise.features.point_pairs.VoteTuning`.
FRONT_WEIGHT = 2.0
#: Cutoffs of the steps between fine points, in their cells: the first bring poses there from twice as coarse ones.
FINE_STEPS = (2.4, 2.4, *LAST_STEPS)
#: A rotation is free if at so many turns around, no more than this share of the part leaves the whole, and no more
#: of the whole comes in front of what the part saw.
NUM_TURNS, LOST_SHARE = 12, 0.05


class TwoScales(NamedTuple):
    """One surface as points a cell and half a cell apart."""

    coarse: LocalSurface
    fine: LocalSurface

    @property
    def mirrored(self) -> TwoScales:
        """The mirror image in the plane x = 0."""
        return TwoScales(self.coarse.mirrored, self.fine.mirrored)

    def seen_from_behind(self) -> TwoScales:
        """Return the surface as what is on its other side would have seen it."""
        return TwoScales(self.coarse.seen_from_behind(), self.fine.seen_from_behind())


@one_blas_thread()
def match_on_whole(
    whole: TwoScales,
    part: TwoScales,
    *,
    group: str = "SO",
    num_candidates: int = 8,
    side_known: bool = True,
) -> LocalPoses:
    """Return distinct rigid poses of a part on a whole, those that explain most of the part first.

    What the whole has in front of what the part saw counts against a pose, where the part was seen from one
    direction. What the part lacks of the whole says nothing.

    Parameters
    ----------
    whole, part : TwoScales
        In one unit of length, with cells of about the same size.
    group : {"SO", "O"}
        O looks among mirror images as well.
    num_candidates : int
        At most so many poses.
    side_known : bool
        Whether the part's normals are on the same side as the whole's; if not, either is tried.

    Returns
    -------
    LocalPoses
        The first overlaps are those of the whole.

    Raises
    ------
    OptionsError
        If the group is unknown.
    """
    check_choice("group", group, ("SO", "O"))
    sides = (part,) if side_known else (part, part.seen_from_behind())
    found = [
        _refined(whole, side.mirrored if flip < 0 else side, flip, num_candidates)
        for side in sides
        for flip in ((1.0,) if group == "SO" else (1.0, -1.0))
    ]
    every = LocalPoses.joined(found)
    score = _score(every.overlaps, every.in_front)
    cell = max(whole.coarse.cell, part.coarse.cell)
    return every[
        poses_apart(every.rotations, every.shifts, score, part.coarse, cell, num_candidates)
    ]


def _refined(whole: TwoScales, part: TwoScales, flip: float, num: int) -> LocalPoses:
    """Return refined poses of a part on a whole, as those of the part itself where it is a mirror image."""
    to, of = whole.coarse, part.coarse
    cell = max(to.cell, of.cell)
    rotations, shifts, votes = pair_vote_poses(to, of)
    order = np.argsort(-votes, kind="stable")  # of poses that fit alike, those of most votes
    rotations, shifts = rotations[order], shifts[order]
    score = _few_score(to, of, rotations, shifts, LOOKED_POINTS, (LOOKED_CELLS, STEP_COSINE))
    likely = poses_apart(rotations, shifts, score, of, cell, NUM_PROPOSED, same=SAME_PROPOSED)
    matches = match_features(feature_distances(to.features, of.features))
    agreed = consensus_poses(to, of, matches, num)
    poses = Similarity.rigid(
        np.concatenate([rotations[likely], agreed[0]]), np.concatenate([shifts[likely], agreed[1]])
    )
    poses = refine_on_planes(to, of, poses, cutoffs=FIRST_STEPS, num_points=PROPOSED_POINTS)
    ends = to, of, poses.rotation, poses.shift
    score = _few_score(*ends, FEW_POINTS, (PARTNER_CELLS, PARTNER_COSINE))
    kept = poses_apart(poses.rotation, poses.shift, score, of, cell, NUM_KEPT * num)
    poses = refine_on_planes(to, of, poses[np.array(kept, dtype=np.int64)], cutoffs=LAST_STEPS)
    poses = refine_on_planes(whole.fine, part.fine, poses, cutoffs=FINE_STEPS)
    found = evaluate_poses(to, of, poses.rotation, poses.shift, matches=matches)
    ends = whole.fine, part.fine, poses.rotation, poses.shift
    in_front, beside = sight_conflicts(*ends)
    return replace(
        found,
        rotations=read_only(found.rotations * [flip, 1.0, 1.0]),
        overlaps=read_only(closeness(*ends)[0]),
        in_front=read_only(in_front),
        beside=read_only(beside),
    )


def free_axis(
    whole: LocalSurface,
    part: LocalSurface,
    rotation: FloatArray,
    shift: FloatArray,
    *,
    side_known: bool = True,
) -> FloatArray | None:
    """Return a point on the axis about which a part turns freely on its whole, and its direction, shape (2, 3).

    None where it does not. The axis is that of the motion that slips best along the whole's normals, or along those
    of the part (Gelfand and Guibas, SGP 2004). It is free if the part lies on the whole all the way round.

    Parameters
    ----------
    whole, part : LocalSurface
    rotation, shift : ndarray, shapes (3, 3) and (3,)
        A pose of determinant 1; the axis is in the whole's coordinates.
    side_known : bool
        Whether the part's normals are on the same side as the whole's; if not, it is that side on which more of the
        part lies on the whole.
    """
    if not side_known:
        sides, pose = (part, part.seen_from_behind()), (rotation[None], shift[None])
        lying = [closeness(whole, side, *pose, num_points=FEW_POINTS)[0][0, 1] for side in sides]
        part = sides[int(np.argmax(lying))]
    placed = part.points @ rotation.T + shift, part.normals @ rotation.T
    turns = 2.0 * np.pi * np.arange(NUM_TURNS) / NUM_TURNS
    for points, normals in ((whole.points, whole.normals), placed):
        axis = _slipping_axis(points, normals)
        if axis is None:
            continue
        about = rotations_by(turns[:, None] * axis[1])
        shifts = about @ (shift - axis[0]) + axis[0]
        ends = whole, part, about @ rotation, shifts
        held = closeness(*ends, num_points=FEW_POINTS)[0][:, 1]
        front = np.nan_to_num(sight_conflicts(*ends, num_points=FEW_POINTS)[0][:, 0])
        if held.min() >= held[0] - LOST_SHARE and front.max() <= front[0] + LOST_SHARE:
            return axis
    return None


def _slipping_axis(points: FloatArray, normals: FloatArray) -> FloatArray | None:
    """Return a point and the direction (2, 3) of the axis of the motion that slips best; None of a translation."""
    centre = points.mean(axis=0)
    arms = points - centre
    size = max(float(np.linalg.norm(arms, axis=1).mean()), np.finfo(float).tiny)
    rows = np.concatenate([np.cross(arms / size, normals), normals], axis=1)
    motions = np.linalg.eigh(rows.T @ rows)[1].T
    turning = np.linalg.norm(motions[:2, :3], axis=1)  # a shaft slips along its axis as well
    turn, move = np.split(motions[int(turning.argmax())], 2)
    length = float(np.linalg.norm(turn))
    if length < 0.1:
        return None
    return np.stack([centre + size * np.cross(turn, move) / length**2, turn / length])


def _few_score(
    whole: LocalSurface,
    part: LocalSurface,
    rotations: FloatArray,
    shifts: FloatArray,
    num_points: int,
    near: tuple[float, float],
) -> FloatArray:
    """Return the score of poses (p, 3, 3), (p, 3) by few points of the part, shape (p,).

    They lie on the whole within so many cells if both normals agree up to a cosine, the two numbers of ``near``.
    """
    from pairwise.features.partners import nearest_facing

    few, back = part.few(num_points), np.swapaxes(rotations, 1, 2)
    placed = part.points[few] @ back + shifts[:, None]
    squares, _ = nearest_facing(
        whole,
        (placed.reshape(-1, 3), (part.normals[few] @ back).reshape(-1, 3)),
        reach=near[0] * max(whole.cell, part.cell),
        cosine=near[1],
    )
    share = np.isfinite(squares).reshape(placed.shape[:2]).mean(axis=1)
    in_front, _ = sight_conflicts(whole, part, rotations, shifts, num_points=FEW_POINTS)
    return np.asarray(share - FRONT_WEIGHT * np.nan_to_num(in_front[:, 0]))


def _score(overlaps: FloatArray, in_front: FloatArray) -> FloatArray:
    """Return by which poses a search keeps, shape (p,)."""
    return np.asarray(overlaps[:, 1] - FRONT_WEIGHT * np.nan_to_num(in_front[:, 0]))
