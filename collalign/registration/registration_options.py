"""What a smooth registration of two surfaces may cost."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.checks import check_count
from data_tools.options import MIN_POINTS


@dataclass(frozen=True, kw_only=True)
class RegistrationOptions:
    """Smooth registration.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    num_centres: int = 600
    """Farthest points of the source at which the Gaussians stand that a deformation is made of."""

    num_points: int = 2500
    """Farthest points of each shape whose closest point on the other pulls."""

    def __post_init__(self) -> None:
        for name in ("num_centres", "num_points"):
            check_count(name, getattr(self, name), lower=MIN_POINTS)
