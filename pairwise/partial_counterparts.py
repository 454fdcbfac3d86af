"""Many poses of one surface on another at once: what has a counterpart, what it costs, and a step of closest points.

A cost is the squared distance of a point from the nearest one of the other surface plus the weighted squared
difference of their normals. Points on a rim pull nothing: what is nearest to a place beyond the rim lies there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.partial_surface import PartialSurface
from data_tools.poses import Similarity
from data_tools.rotations import nearest_orthogonal


class PartialTuning(NamedTuple):
    """Numbers of matching in part; lengths are in root mean square radii of the target.

    What weighs counterparts was chosen on shapes at even positions of teeth, glasses and ants with a quarter cut off;
    what proposes poses, on 12 pieces of generated bones, chairs and ants.
    """

    num_proposed: int = 8
    """Poses that are proposed at each scale, ..."""
    scale_step: float = 0.35
    """... the logarithms of whose ratios are about this."""
    scale_range: tuple[float, float] = (0.3, 1.6)
    """Scales, relative to equal radii, of sources of unknown size: a third of a bone has half its radius."""
    same_deg: float = 10.0
    """Poses nearer than this in angle ..."""
    same_shift: float = 0.3
    """... and in shift are one."""
    least_described: int = 100
    """Neighbourhoods of a source at least; of smaller ones, where it is small, if need be."""
    num_points: tuple[int, int] = (150, 500)
    """Points of each surface that are compared where many poses are ranked, and where few are refined."""
    steps: tuple[float | None, ...] = (0.35,) * 3 + (0.3,) * 3 + (0.25,) * 4 + (None,) * 8
    """Cutoffs of the refinement's steps; None for a pose's own."""
    normal_weight: float = 0.3
    """Of unit normals relative to positions. With weights 0, .1, .2 and .4, 52, 65, 82 and 88 % of 40 pairs of teeth
    that are both cut are right, and 23, 40, 53 and 53 % of 30 pairs of ants of which one is; .4 loses glasses (70 for
    75 % of 20)."""
    resolution: float = 0.05
    """Costs count by their logarithm, this squared length added: the noise of shapes that differ is unknown, and a
    fit that is twice as good over a part counts as much at any level."""
    cutoff: float = 0.4
    """Whatever is farther than this is as good as absent."""
    counterpart: float = 0.25
    """A point has a counterpart if its cost is below this squared length."""
    own_cutoff: float = 2.5
    """A pose's own cutoff is so many times the root of the median cost of what has a counterpart, ..."""
    least_cutoff: float = 0.06
    """... and not below this."""


#: The numbers of matching in part that are in use.
TUNED = PartialTuning()
#: Sum of weights, of at most 2, below which a pose moves no more.
_LEAST_WEIGHT = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Counterparts:
    """Nearest points both ways, in squared radii of the target; infinite costs where there is none.

    Attributes
    ----------
    of_source, of_target : ndarray of int, shapes (p, m) and (p, l)
        The target's point nearest to each of the source's, and the other way round.
    source_costs, target_costs : ndarray, shapes (p, m) and (p, l)
    """

    of_source: IntArray
    of_target: IntArray
    source_costs: FloatArray
    target_costs: FloatArray

    @property
    def energies(self) -> FloatArray:
        """Geometric mean over both surfaces of cost + resolution^2, costs at most the squared cutoff, shape (p,)."""
        means = [
            np.log(np.minimum(costs, TUNED.cutoff**2) + TUNED.resolution**2).mean(axis=1)
            for costs in (self.source_costs, self.target_costs)
        ]
        return np.asarray(np.exp(means[0] + means[1]) ** 0.5)

    def own_cutoffs(self) -> FloatArray:
        """Return the cutoff that suits each pose, from the median cost of what has a counterpart, shape (p,)."""
        costs = np.concatenate([self.source_costs, self.target_costs], axis=1)
        there = np.where(costs < TUNED.counterpart**2, costs, np.nan)
        there[np.isnan(there).all(axis=1)] = TUNED.counterpart**2
        return np.clip(
            TUNED.own_cutoff * np.sqrt(np.nanmedian(there, axis=1)),
            TUNED.least_cutoff,
            TUNED.counterpart,
        )

    def overlaps(self) -> FloatArray:
        """Return the share of the target, and that of the source, with a counterpart, shape (p, 2)."""
        return np.stack(
            [
                (costs < TUNED.counterpart**2).mean(axis=1)
                for costs in (self.target_costs, self.source_costs)
            ],
            axis=1,
        )


def counterparts(
    target: PartialSurface, source: PartialSurface, poses: Similarity, num_points: int
) -> Counterparts:
    """Return what the first points of both surfaces are nearest to at each pose."""
    to, of = target.points[:num_points], source.points[:num_points]
    moved, unmoved = poses.apply(of), poses.undo(to)
    of_source, of_target = target.nearest(moved), source.nearest(unmoved)
    rotated = source.normals[:num_points] @ np.swapaxes(poses.rotation, 1, 2)
    rotated_back = target.normals[:num_points] @ poses.rotation
    there = _squared(moved - target.points.take(of_source, axis=0)) / target.radius**2
    back = _squared(unmoved - source.points.take(of_target, axis=0)) / target.radius**2
    back *= poses.scale[:, None] ** 2
    signed = target.oriented and source.oriented
    there += TUNED.normal_weight**2 * _apart(rotated, target.normals[of_source], signed=signed)
    back += TUNED.normal_weight**2 * _apart(rotated_back, source.normals[of_target], signed=signed)
    return Counterparts(
        of_source=of_source,
        of_target=of_target,
        source_costs=np.where(of_source < 0, np.inf, there),
        target_costs=np.where(of_target < 0, np.inf, back),
    )


def _squared(vectors: FloatArray) -> FloatArray:
    """Return the squared lengths of vectors (p, l, 3), shape (p, l)."""
    return np.asarray(np.einsum("pla,pla->pl", vectors, vectors))


def _apart(first: FloatArray, second: FloatArray, *, signed: bool) -> FloatArray:
    """Return the squared distance of unit normals; of the nearer of both directions where their signs are unknown."""
    squared = _squared(first - second)
    return squared if signed else np.minimum(squared, np.maximum(4.0 - squared, 0.0))


def step(
    targets: Sequence[PartialSurface],
    source: PartialSurface,
    poses: Similarity,
    *,
    num_points: int,
    cutoff: float | None,
    scale_range: tuple[float | FloatArray, float | FloatArray],
    hold_rotations: bool = False,
) -> Similarity:
    """Move each pose to the similarity that brings counterparts together best, on one or several posed targets.

    ``scale_range`` holds the least and the largest scale, numbers or arrays of shape (p,), one per pose.

    Weights are Tukey's biweight of the costs at the cutoff (in radii), zero where either point lies on a rim, each
    surface's in sum its share of counterparts. Without a cutoff each pose sets its own, by how well it fits.
    """
    parts = []
    for target in targets:
        found = counterparts(target, source, poses, num_points)
        reach = found.own_cutoffs() if cutoff is None else np.full(len(poses), cutoff)
        there, back = (
            np.clip(1.0 - costs / reach[:, None] ** 2, 0.0, 1.0) ** 2 / costs.shape[1]
            for costs in (found.source_costs, found.target_costs)
        )
        there *= ~(target.on_rim[found.of_source] | source.on_rim[: there.shape[1]])
        back *= ~(source.on_rim[found.of_target] | target.on_rim[: back.shape[1]])
        to, of = (
            np.broadcast_to(item.points[:num_points], (len(poses), *item.points[:num_points].shape))
            for item in (target, source)
        )
        parts.append((target.points[found.of_source], of, there))
        parts.append((to, source.points[found.of_target], back))
    to, of, weights = (np.concatenate([part[n] for part in parts], axis=1) for n in range(3))
    return _similarities(to, of, weights, poses, scale_range, hold_rotations=hold_rotations)


def _similarities(
    to: FloatArray,
    of: FloatArray,
    weights: FloatArray,
    poses: Similarity,
    scale_range: tuple[float | FloatArray, float | FloatArray],
    *,
    hold_rotations: bool,
) -> Similarity:
    """Return the weighted similarities (Umeyama 1991; symmetric scale) that keep each pose's chirality."""
    total = weights.sum(axis=1, keepdims=True)
    share = weights / np.maximum(total, _LEAST_WEIGHT)
    mean_to, mean_of = ((share[:, None] @ points)[:, 0] for points in (to, of))
    to, of = to - mean_to[:, None], of - mean_of[:, None]
    moments = np.swapaxes(share[..., None] * to, 1, 2) @ of
    signs = np.where(np.linalg.det(poses.rotation) < 0, -1.0, 1.0)
    rotations = poses.rotation
    if not hold_rotations:
        rotations = (
            nearest_orthogonal(moments * signs[:, None, None], determinant=1.0)
            * signs[:, None, None]
        )
    sizes = [(share * _squared(points)).sum(axis=1) for points in (to, of)]
    scales = np.clip(np.sqrt(sizes[0] / np.maximum(sizes[1], np.finfo(float).tiny)), *scale_range)
    shifts = mean_to - scales[:, None] * np.einsum("pab,pb->pa", rotations, mean_of)
    is_held = total[:, 0] < _LEAST_WEIGHT
    return Similarity(
        rotation=np.where(is_held[:, None, None], poses.rotation, rotations),
        scale=np.where(is_held, poses.scale, scales),
        shift=np.where(is_held[:, None], poses.shift, shifts),
    )
