"""Matches two surfaces that overlap in part: rotations, shifts and scales searched, then trimmed closest points.

Centroids and sizes of different parts of a shape say nothing, so all seven unknowns are searched: a low-discrepancy
set of rotations, the places where a part of the source's size has its centroid, a few scales. The best are refined by
closest points of both surfaces, of which those without a counterpart have no say, and compared by the energy of
:class:`pairwise.partial.counterparts.Counterparts`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import FloatArray, IntArray
from data_tools.checks import check_choice
from data_tools.poses import Similarity, pose_angle_deg
from data_tools.threads import one_blas_thread
from pairwise.local.rotation_sets import rotation_set
from pairwise.partial.counterparts import counterparts, step
from pairwise.partial.surface import PartialSurface
from pairwise.partial.tuning import TUNED

#: Poses nearer than this in angle and in shift (radii) are one.
SAME_POSE_DEG, SAME_SHIFT = 10.0, 0.3


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
    """Return distinct poses of a source on a target, the least energy first.

    Parameters
    ----------
    target, source : PartialSurface
    group : {"SO", "O"}
        O looks among mirror images as well.
    scale_range : pair of float, optional
        The least and the largest factor of the source; (1, 1) where both have the same units. Without it, those of
        shapes of about the same size.
    num_candidates : int
        At most so many poses.

    Raises
    ------
    OptionsError
        If the group is unknown.
    """
    check_choice("group", group, ("SO", "O"))
    scale_range = scale_range or scales_allowed([target], source)
    starts = _starts(target, source, group, scale_range)
    few, many = TUNED.num_points
    poses = refine(
        [target], source, starts, TUNED.few_steps, num_points=few, scale_range=scale_range
    )
    found = counterparts(target, source, poses, few)
    poses = poses[distinct_similarities(poses, found.energies, TUNED.num_refined, target.radius)]
    poses = refine(
        [target], source, poses, TUNED.many_steps, num_points=many, scale_range=scale_range
    )
    found = counterparts(target, source, poses, many)
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


def scales_allowed(
    targets: Sequence[PartialSurface], source: PartialSurface
) -> tuple[float, float]:
    """Return the least and the largest factor of a source of unknown size."""
    ratios = [target.radius / source.radius for target in targets]
    return TUNED.scale_range[0] * min(ratios), TUNED.scale_range[1] * max(ratios)


def refine(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    poses: Similarity,
    cutoffs: Sequence[float | None] = TUNED.many_steps,
    *,
    num_points: int = TUNED.num_points[1],
    scale_range: tuple[float | FloatArray, float | FloatArray],
    hold_rotations: bool = False,
) -> Similarity:
    """Refine poses by closest points on one or several targets in one frame, one step per cutoff.

    With ``hold_rotations`` only shifts and scales change. ``scale_range`` is the least and the largest scale, numbers
    or arrays of shape (p,), one per pose.
    """
    for cutoff in cutoffs:
        poses = step(
            targets,
            source,
            poses,
            num_points=num_points,
            cutoff=cutoff,
            scale_range=scale_range,
            hold_rotations=hold_rotations,
        )
    return poses


def distinct_similarities(
    poses: Similarity, energies: FloatArray, num: int, radius: float
) -> IntArray:
    """Return positions of at most so many poses that differ, the least of the energies (m,) first."""
    kept: list[int] = []
    for p in np.argsort(energies, kind="stable").tolist():
        apart = pose_angle_deg(poses.rotation[kept], poses.rotation[p]) > SAME_POSE_DEG
        shifted = np.linalg.norm(poses.shift[kept] - poses.shift[p], axis=1) > SAME_SHIFT * radius
        if (apart | shifted).all():
            kept.append(p)
        if len(kept) == num:
            break
    return np.array(kept, dtype=np.int64)


def _starts(
    target: PartialSurface, source: PartialSurface, group: str, scale_range: tuple[float, float]
) -> Similarity:
    """Return the best pose of each rotation, the most promising rotations."""
    from pairwise.partial.screen import screen_similarities  # compiled, and loads Numba

    rotations = rotation_set(3, TUNED.num_rotations)
    if group == "O":
        rotations = np.concatenate([rotations, -rotations])
    # Surfaces are searched about their centres, in radii of the target.
    to, of = target.centred(target.radius), source.centred(target.radius)
    num_scales = 1 + int(np.log(scale_range[1] / scale_range[0]) / TUNED.scale_step)
    scales = np.geomspace(*scale_range, num_scales + 2)[1:-1]
    shifts = [centres_of_parts(to, float(scale) * of.radius) for scale in scales]
    found = [
        screen_similarities(to, of, rotations, *each) for each in zip(shifts, scales, strict=True)
    ]
    which = np.argmin([costs for costs, _ in found], axis=0)
    costs = np.array([found[s][0][r] for r, s in enumerate(which)])
    best = np.argsort(costs, kind="stable")[: TUNED.num_starts * (2 if group == "O" else 1)]
    places = np.array([shifts[which[r]][found[which[r]][1][r]] for r in best])
    rotations, factors = rotations[best], scales[which[best]]
    shift = target.centre + target.radius * places - factors[:, None] * (rotations @ source.centre)
    return Similarity(rotation=rotations, scale=factors, shift=shift)


def centres_of_parts(surface: PartialSurface, radius: float) -> FloatArray:
    """Return where shapes of this root mean square radius may have their centroids on a surface about its origin.

    Large ones lie on it as a whole, on a lattice; smaller ones are parts of it.
    """
    if radius >= TUNED.part:
        steps = np.arange(-TUNED.reach, TUNED.reach + 1e-9, TUNED.shift)
        lattice = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
        return np.asarray(lattice[np.linalg.norm(lattice, axis=1) <= TUNED.reach + 1e-9])
    points = surface.points[: TUNED.num_points[1]]
    near = cKDTree(points).query_ball_point(points[: TUNED.num_points[0]], TUNED.extent * radius)
    means = np.concatenate([np.zeros((1, 3)), [points[members].mean(axis=0) for members in near]])
    kept, gaps = [0], np.linalg.norm(means, axis=1)
    while len(kept) < TUNED.most_shifts and gaps.max() > TUNED.spacing * radius:
        kept.append(int(gaps.argmax()))
        gaps = np.minimum(gaps, np.linalg.norm(means - means[kept[-1]], axis=1))
    return np.asarray(means[kept])
