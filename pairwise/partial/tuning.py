"""Every number that matching in part was tuned by, in one table."""

from __future__ import annotations

from typing import NamedTuple


class PartialTuning(NamedTuple):
    """Numbers of a search; lengths are in root mean square radii of the target.

    Chosen on shapes at even positions of teeth, glasses and ants with a quarter cut off. Of 8 pairs each at odd
    positions 100 % of teeth of which one is cut are right, 88 % where both
    are, 75 % of glasses, 50 % of ants; of classes on which nothing was chosen, 88 % of chairs and 62 % of teddies.
    """

    num_rotations: int = 1500
    """Rotations that are searched, about 20 degrees apart; per chirality."""
    reach: float = 0.6
    """Shifts of the centroids of large sources that are searched, ..."""
    shift: float = 0.3
    """... and the spacing of their lattice."""
    part: float = 0.7
    """A source of a smaller radius is searched as a part of the target."""
    extent: float = 1.5
    """A part's centroid is that of the target's points within so many of the part's radii of one of them, ..."""
    spacing: float = 0.25
    """... at most so many of these radii from one that is searched, ..."""
    most_shifts: int = 60
    """... of which there are no more than this."""
    scale_step: float = 0.35
    """Logarithm of the ratio of scales that are searched, about."""
    scale_range: tuple[float, float] = (0.6, 1.6)
    """Scales, relative to equal radii, beyond which refinement does not go."""
    num_points: tuple[int, int] = (150, 500)
    """Points of each surface that are compared in the refinement of many poses, and of few."""
    num_starts: int = 300
    """Poses that are refined on few points, per chirality, ..."""
    num_refined: int = 40
    """... and those of them that are on many."""
    few_steps: tuple[float, ...] = (0.4,) * 4 + (0.35,) * 6
    """Cutoffs of the refinement's steps on few points."""
    many_steps: tuple[float | None, ...] = (0.35,) * 3 + (0.3,) * 3 + (0.25,) * 4 + (None,) * 8
    """Cutoffs of the refinement's steps on many; None for a pose's own."""
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
