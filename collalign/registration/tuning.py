"""Every number that a registration was tuned by, in one table."""

from __future__ import annotations

from typing import NamedTuple


class RegistrationTuning(NamedTuple):
    """Numbers of a registration; lengths are in parts of the shapes' root mean square radius.

    Chosen on eight mouse skulls and sixteen molars, by how well their landmarks carry each other's places over from
    the landmarks' own poses, those of the pose on ten skulls, by how near it is to that of the landmarks; quoted
    figures are of other specimens. ``python -m experiments calibrate registration`` tries other values of each on
    four specimens of either kind, and on each kind what is best on the other.
    """

    num_centres: int = 600
    """Farthest points of the source at which the Gaussians stand that a deformation is made of."""
    num_points: int = 2500
    """Farthest points of each shape whose closest point on the other pulls."""
    widths: tuple[float, ...] = (0.6, 0.3)
    """Of the Gaussians. Adding .15 follows detail that landmarks do not."""
    amplitudes: tuple[float, ...] = (0.15, 0.09)
    """Standard deviation of a displacement that each width is expected to need."""
    noise: tuple[float, ...] = (0.06, 0.045, 0.03, 0.02, 0.015, 0.01, 0.01, 0.01)
    """How far correspondences are trusted, one value per iteration: coarse deformations first."""
    normal_noise: float = 0.03
    """How far normals are trusted: a difference of normals of this length counts as much as a distance of the
    iteration's noise. So normals choose the slope of a cusp at first, and positions decide at last."""
    min_cosine: float = 0.3
    """Correspondences of normals that differ by more than this cosine says do not count."""
    tangential: float = 0.5
    """Share of a correspondence's offset along the target's surface that pulls; 0 lets points slide freely. Molars
    err least at .7 and more below .4; skulls do not care between .2 and .4."""
    cutoff: float = 3.0
    """Correspondences beyond so many times the median distance, or the noise where that is more, do not count."""
    num_independent: int = 60
    """However many correspondences there are, they weigh like so many independent ones: neighbours say the same. With
    6000, nine of ten pairs of molars fold and skulls err 5 % more; from 400 to 60 nothing changes but fewer folds."""
    num_compared: int = 4
    """Iterations after which the pose of less energy is kept. After fewer, closest points that slid look as good."""
    num_pose_points: int = 800
    """Farthest points of each surface that settle the pose."""
    pose_noise: tuple[float, ...] = (0.06,) * 3 + (0.03,) * 9
    """How far correspondences are trusted on the way to the pose."""
    pose_cutoff: float = 6.0
    """As ``cutoff``, while the pose settles; 3 leaves sizes of skulls .1 % worse and rotations .03 deg."""


class BentTuning(NamedTuple):
    """Numbers of a registration that starts from maps of bodies that bend; lengths in the same unit.

    What starts was chosen while looking at six ants, armadillos, humans and centaurs each, by where landmarks end up;
    six glasses were only measured: .10 radii instead of .30 (``docs/tutorials/deformable.md``). The fit was chosen on
    twenty bodies of SCAPE; of the centaur, which was held back, ``python -m experiments consistent_maps`` measures
    the maps.
    """

    length: float = 0.1
    """What a map says of neighbours is averaged over so far."""
    loose: float = 1e3
    """So loosely unbent copies stay where the source is: an unbent surface may lie anywhere."""
    least_share: float = 0.5
    """A map with goals for less than this share of the surface starts nothing."""
    least_extent: float = 0.5
    """Nor does one that leaves less than this of the surface's extent: one without order takes all to the middle."""
    most_rotation_deg: float = 60.0
    """Nor one that rotates the whole surface by more than this against its pose: maps are right that rotate it by up
    to 16 degrees; those by 176 and more take the head for the tail."""
    map_length: float = 0.05
    """What a map says of neighbours is averaged over so far before closest points pull. The bodies err .0144 to .0147
    sqrt(area) with .03 to .1, and .0163 with .2; the centaur errs least with .06."""
    point_length: float = 0.03
    """What closest points say of neighbours is averaged over so far."""
    normal_weight: float = 0.4
    """Of unit normals relative to positions: normals lay muscles and features onto each other. With a third of that,
    seven bodies err 2 % more."""


#: The numbers in use.
TUNED, BENT = RegistrationTuning(), BentTuning()
