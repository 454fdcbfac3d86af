"""How one posed surface is registered to another, and what was measured to choose it."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.checks import check_count, check_number
from data_tools.errors import OptionsError
from data_tools.options import MIN_POINTS


@dataclass(frozen=True, kw_only=True)
class RegistrationOptions:
    """Smooth registration; lengths are in parts of the shapes' root mean square radius.

    Chosen on eight mouse skulls and sixteen molars, by how well their landmarks carry each other's places over from
    the landmarks' own poses; quoted figures are of other specimens. ``python -m experiments calibrate registration``
    tries other values on four of each.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    widths: tuple[float, ...] = (0.6, 0.3)
    """Widths of the Gaussians that a deformation is made of. Adding .15 follows detail that landmarks do not."""

    amplitudes: tuple[float, ...] = (0.15, 0.09)
    """Standard deviation of a displacement that each width is expected to need."""

    noise: tuple[float, ...] = (0.06, 0.045, 0.03, 0.02, 0.015, 0.01, 0.01, 0.01)
    """How far correspondences are trusted, one value per iteration: coarse deformations first."""

    num_centres: int = 600
    """Farthest points of the source at which Gaussians stand."""

    num_points: int = 2500
    """Farthest points of each shape whose closest point on the other pulls."""

    normal_noise: float = 0.03
    """How far normals are trusted: a difference of normals of this length counts as much as a distance of the
    iteration's noise. So normals choose the slope of a cusp at first, and positions decide at last."""

    tangential: float = 0.5
    """Share of a correspondence's offset along the target's surface that pulls; 0 lets points slide freely. Molars
    err least at .7 and more below .4; skulls do not care between .2 and .4."""

    cutoff: float = 3.0
    """Correspondences beyond so many times the median distance, or the noise where that is more, do not count."""

    min_cosine: float = 0.3
    """Nor do those whose normals differ by more than this cosine says."""

    def __post_init__(self) -> None:
        if not self.widths or len(self.widths) != len(self.amplitudes):
            raise OptionsError("amplitudes: expected one per width, at least one")
        for name in ("widths", "amplitudes", "noise"):
            if not getattr(self, name) or not all(value > 0 for value in getattr(self, name)):
                raise OptionsError(f"{name}: expected positive numbers, got {getattr(self, name)!r}")
        for name in ("num_centres", "num_points"):
            check_count(name, getattr(self, name), lower=MIN_POINTS)
        for name in ("normal_noise", "cutoff"):
            check_number(name, getattr(self, name), positive=True)
        check_number("tangential", self.tangential, upper=1.0)
        check_number("min_cosine", self.min_cosine, lower=-1.0, upper=1.0)
        if self.min_cosine == 1.0:
            raise OptionsError("min_cosine: expected a number below 1, got 1: no two normals agree that much")
