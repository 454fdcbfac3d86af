"""Every number that matching in part was tuned by, in one table."""

from __future__ import annotations

from typing import NamedTuple


class PartialTuning(NamedTuple):
    """Numbers of a search; lengths are in root mean square radii of the target.

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


#: The numbers in use.
TUNED = PartialTuning()
