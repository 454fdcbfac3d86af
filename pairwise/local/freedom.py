"""What a pose may do beside turning."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Freedom:
    """What a pose may do beside turning.

    Attributes
    ----------
    scale_range : pair of float, or None
        Scale the source, within these limits.
    translate : bool
        Shift the source.
    """

    scale_range: tuple[float, float] | None = None
    translate: bool = False


#: Rotations only, as in Procrustes matching.
RIGID = Freedom()
