"""Matches two surfaces that overlap in part, at any scale.

Centroids and sizes of different parts of a shape say nothing. Poses on which neighbourhoods agree at a few scales are
refined on the planes of the target, where points without a counterpart have no say. They are compared by the energy
of :class:`pairwise.partial_counterparts.Counterparts`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.checks import check_choice
from data_tools.local_surface import PART_CELL, LocalSurface, SurfacePlanes
from data_tools.partial_surface import PartialSurface
from data_tools.poses import Similarity, pose_angle_deg
from data_tools.threads import one_blas_thread
from pairwise.features.poses import (
    FIRST_STEPS,
    consensus_poses,
    feature_distances,
    match_features,
    refine_on_planes,
)
from pairwise.partial_counterparts import TUNED, counterparts


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchedPose:
    """A pose of a source on a target that it overlaps in part.

    Attributes
    ----------
    pose : Similarity
        Takes the source to the target.
    energy : float
        Geometric mean of squared distances, normals included, what has no counterpart at the cutoff; in squared radii
        of the target.
    overlap_target, overlap_source : float
        Share of each surface's points with a counterpart on the other.
    """

    pose: Similarity
    energy: float
    overlap_target: float
    overlap_source: float


@one_blas_thread()
def match_partial(
    target: PartialSurface,
    source: PartialSurface,
    *,
    group: str = "SO",
    scale_range: tuple[float, float] | None = None,
    num_candidates: int = 16,
) -> tuple[SearchedPose, ...]:
    """Return distinct poses of a source on a target, the least energy first; none where no neighbourhoods agree.

    Parameters
    ----------
    target, source : PartialSurface
    group : {"SO", "O"}
        O looks among mirror images as well.
    scale_range : pair of float, optional
        The least and the largest factor of the source; (1, 1) where both have the same units. Without it, those at
        which either may be a part of the other.
    num_candidates : int
        At most so many poses.

    Raises
    ------
    OptionsError
        If the group is unknown.
    """
    ratio, (least, _) = target.radius / source.radius, TUNED.scale_range
    scale_range = scale_range or (ratio * least, ratio / least)
    proposed = propose_poses(target, source, group=group, scale_range=scale_range)
    if not len(proposed):
        return ()
    poses = refine([target], source, proposed, scale_range=scale_range)
    found = counterparts(target, source, poses, TUNED.num_points[1])
    energies, overlaps = found.energies, found.overlaps()
    return tuple(
        SearchedPose(
            pose=poses[int(p)],
            energy=float(energies[p]),
            overlap_target=float(overlaps[p, 0]),
            overlap_source=float(overlaps[p, 1]),
        )
        for p in distinct_similarities(poses, energies, num_candidates, target.radius)
    )


@one_blas_thread()
def propose_poses(
    target: PartialSurface,
    source: PartialSurface,
    *,
    group: str = "SO",
    scale_range: tuple[float, float],
) -> Similarity:
    """Return poses near which neighbourhoods of two surfaces agree, at a few scales of the source.

    Where the outer side of a surface is not known, either side of the source may face that of the target.

    Parameters
    ----------
    target, source : PartialSurface
    group : {"SO", "O"}
        O looks among mirror images as well.
    scale_range : pair of float
        The least and the largest factor of the source.

    Raises
    ------
    OptionsError
        If the group is unknown.
    """
    check_choice("group", group, ("SO", "O"))
    num_scales = 1 + int(np.log(scale_range[1] / scale_range[0]) / TUNED.scale_step)
    rotations, scales, shifts = [np.empty((0, 3, 3))], [np.empty(0)], [np.empty((0, 3))]
    for scale in np.geomspace(*scale_range, num_scales + 2)[1:-1].tolist():
        to, of = describe_both(target, source, scale)
        limits = scale_range[0] / scale, scale_range[1] / scale
        for flip in (1.0,) if group == "SO" else (1.0, -1.0):
            mirrored = of if flip > 0 else of.mirrored
            for one in (
                (mirrored,)
                if target.oriented and source.oriented
                else (mirrored, mirrored.reversed())
            ):
                matches = match_features(feature_distances(to.features, one.features))
                first = Similarity.rigid(*consensus_poses(to, one, matches, TUNED.num_proposed))
                found = refine_on_planes(
                    to,
                    one,
                    first,
                    cutoffs=FIRST_STEPS,
                    num_points=TUNED.num_points[0],
                    scale_range=limits,
                )
                rotations.append(found.rotation * [flip, 1.0, 1.0])
                scales.append(scale * found.scale)
                shifts.append(found.shift)
    return Similarity(
        rotation=np.concatenate(rotations),
        scale=np.concatenate(scales),
        shift=np.concatenate(shifts),
    )


def describe_both(
    target: PartialSurface, source: PartialSurface, scale: float = 1.0
) -> tuple[LocalSurface, LocalSurface]:
    """Return the neighbourhoods of a target and of a source, scaled by a factor, in cells of one size.

    Points lie one cell apart, or less densely where a surface has not so many: cells are so small that even the
    smaller one has enough of them.
    """
    gaps = target.gaps, scale * source.gaps
    cell = max(PART_CELL * target.radius, *(float(one[-1]) for one in gaps))
    cell = min(cell, *(float(one[: TUNED.least_described][-1]) for one in gaps))
    return target.described(cell), source.described(cell, scale)


def scales_allowed(
    targets: Sequence[PartialSurface], source: PartialSurface
) -> tuple[float, float]:
    """Return the least and the largest factor of a source of unknown size that is a part of the targets, or whole."""
    ratios = [target.radius / source.radius for target in targets]
    return TUNED.scale_range[0] * min(ratios), TUNED.scale_range[1] * max(ratios)


def refine(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    poses: Similarity,
    *,
    num_points: int = TUNED.num_points[1],
    scale_range: tuple[float | FloatArray, float | FloatArray],
    hold_rotations: bool = False,
) -> Similarity:
    """Refine poses on the planes of one or several targets in one frame.

    With ``hold_rotations`` only shifts and scales change. ``scale_range`` is the least and the largest scale, numbers
    or arrays of shape (p,), one per pose.
    """
    cell = PART_CELL * float(np.mean([target.radius for target in targets]))
    to, of = (
        SurfacePlanes(
            points=np.concatenate([one.points[:num_points] for one in several]),
            normals=np.concatenate([one.normals[:num_points] for one in several]),
            cell=cell,
        )
        for several in (targets, (source,))
    )
    return refine_on_planes(
        to,
        of,
        poses,
        scale_range=scale_range,
        hold_rotations=hold_rotations,
        sides_known=all(one.oriented for one in (*targets, source)),
    )


def distinct_similarities(
    poses: Similarity, energies: FloatArray, num: int, radius: float
) -> IntArray:
    """Return positions of at most so many poses that differ, the least of the energies (m,) first."""
    kept: list[int] = []
    for p in np.argsort(energies, kind="stable").tolist():
        apart = pose_angle_deg(poses.rotation[kept], poses.rotation[p]) > TUNED.same_deg
        shifted = (
            np.linalg.norm(poses.shift[kept] - poses.shift[p], axis=1) > TUNED.same_shift * radius
        )
        if (apart | shifted).all():
            kept.append(p)
        if len(kept) == num:
            break
    return np.array(kept, dtype=np.int64)
