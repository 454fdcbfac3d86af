"""Matches two surfaces that overlap in part: rotations, shifts and scales searched, then trimmed closest points.

Centroids and sizes of different parts of a shape say nothing, so all seven unknowns are searched: a low-discrepancy
set of rotations, a lattice of shifts, a few scales. The best of each rotation are refined by closest points of both
surfaces, of which those without a counterpart have no say, and compared by the energy of :class:`Counterparts`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.checks import check_choice
from data_tools.poses import Similarity, turn_deg
from data_tools.threads import one_blas_thread
from pairwise.local.rotation_sets import rotation_set
from pairwise.partial.counterparts import Counterparts, counterparts, step
from pairwise.partial.surface import PartialSurface
from pairwise.partial.tuning import TUNED

#: Poses nearer than this in angle and in shift (radii) are one.
SAME_POSE_DEG, SAME_SHIFT = 10.0, 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class PartialPose:
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
    estimate_scale: bool = True,
    num_candidates: int = 16,
) -> tuple[PartialPose, ...]:
    """Return distinct poses of a source on a target, the least energy first.

    Parameters
    ----------
    target, source : PartialSurface
    group : {"SO", "O"}
        O looks among mirror images as well.
    estimate_scale : bool
        Without it the units of both are the same.
    num_candidates : int
        At most so many poses.

    Raises
    ------
    OptionsError
        If the group is unknown.
    """
    check_choice("group", group, ("SO", "O"))
    scale_range = scales_allowed(target, source, estimate_scale=estimate_scale)
    starts = _starts(target, source, group, estimate_scale=estimate_scale)
    few, many = TUNED.num_points
    poses = refine([target], source, starts, TUNED.few_steps, num_points=few, scale_range=scale_range)
    found = counterparts(target, source, poses, few)
    poses = poses[distinct_similarities(poses, found.energies, TUNED.num_refined, target.radius)]
    poses = refine([target], source, poses, TUNED.many_steps, num_points=many, scale_range=scale_range)
    found = counterparts(target, source, poses, many)
    return ranked(target, poses, found, num_candidates)


def scales_allowed(target: PartialSurface, source: PartialSurface, *, estimate_scale: bool) -> tuple[float, float]:
    """Return the least and the largest factor of the source."""
    if not estimate_scale:
        return 1.0, 1.0
    ratio = target.radius / source.radius
    return TUNED.scale_range[0] * ratio, TUNED.scale_range[1] * ratio


def refine(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    poses: Similarity,
    cutoffs: Sequence[float | None] = TUNED.many_steps,
    *,
    num_points: int = TUNED.num_points[1],
    scale_range: tuple[float, float],
    hold_turns: bool = False,
) -> Similarity:
    """Refine poses by closest points on one or several targets in one frame, one step per cutoff.

    With ``hold_turns`` only shifts and scales change.
    """
    for cutoff in cutoffs:
        poses = step(
            targets,
            source,
            poses,
            num_points=num_points,
            cutoff=cutoff,
            scale_range=scale_range,
            hold_turns=hold_turns,
        )
    return poses


def ranked(
    target: PartialSurface, poses: Similarity, found: Counterparts, num_candidates: int
) -> tuple[PartialPose, ...]:
    """Return the distinct poses, the least energy first."""
    energies, overlaps = found.energies, found.overlaps()
    return tuple(
        PartialPose(
            pose=poses[int(p)],
            energy=float(energies[p]),
            overlap_target=float(overlaps[p, 0]),
            overlap_source=float(overlaps[p, 1]),
        )
        for p in distinct_similarities(poses, energies, num_candidates, target.radius)
    )


def distinct_similarities(poses: Similarity, energies: FloatArray, num: int, radius: float) -> IntArray:
    """Return at most so many poses that differ, the least energy first."""
    kept: list[int] = []
    for p in np.argsort(energies, kind="stable").tolist():
        apart = turn_deg(poses.rotation[kept], poses.rotation[p]) > SAME_POSE_DEG
        shifted = np.linalg.norm(poses.shift[kept] - poses.shift[p], axis=1) > SAME_SHIFT * radius
        if (apart | shifted).all():
            kept.append(p)
        if len(kept) == num:
            break
    return np.array(kept, dtype=np.int64)


def _starts(target: PartialSurface, source: PartialSurface, group: str, *, estimate_scale: bool) -> Similarity:
    """Return the best pose of each rotation, the most promising rotations."""
    from pairwise.partial.screen import screen_similarities  # compiled, and loads Numba

    turns = rotation_set(3, TUNED.num_turns)
    if group == "O":
        turns = np.concatenate([turns, -turns])
    ratio = target.radius / source.radius if estimate_scale else 1.0
    scales = ratio * np.array(TUNED.scales) if estimate_scale else np.ones(1)
    # Surfaces are searched about their centres, in radii of the target.
    to, of = target.centred(target.radius), source.centred(target.radius)
    lattice = _lattice()
    costs, which_shift, which_scale = screen_similarities(to, of, turns, lattice, scales)
    best = np.argsort(costs, kind="stable")[: TUNED.num_starts * (2 if group == "O" else 1)]
    turns, factors = turns[best], scales[which_scale[best]]
    shifts = target.centre + target.radius * lattice[which_shift[best]]
    return Similarity(rotation=turns, scale=factors, shift=shifts - factors[:, None] * (turns @ source.centre))


@lru_cache(maxsize=1)
def _lattice() -> FloatArray:
    """Return the shifts of a cubic lattice within reach, the shortest first, shape (t, 3)."""
    most = int(TUNED.reach / TUNED.spacing)
    steps = TUNED.spacing * np.arange(-most, most + 1)
    shifts = np.array(list(product(steps, steps, steps)))
    lengths = np.linalg.norm(shifts, axis=1)
    order = np.argsort(lengths, kind="stable")
    return read_only(shifts[order[lengths[order] <= TUNED.reach + 1e-9]])
