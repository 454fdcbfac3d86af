"""Many poses of one surface on another at once: what has a counterpart, and what it costs.

A cost is the squared distance of a point from the nearest one of the other surface plus the weighted squared
difference of their normals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.partial_surface import PartialSurface
from data_tools.poses import Similarity


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
    """Points of each surface that are compared where poses are many, and where few are refined."""
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


#: The numbers of matching in part that are in use.
TUNED = PartialTuning()


@dataclass(frozen=True, kw_only=True, eq=False)
class Counterparts:
    """Nearest points both ways, in squared radii of the target; infinite costs where there is none.

    Attributes
    ----------
    source_costs, target_costs : ndarray, shapes (p, m) and (p, l)
    """

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
