"""Shares in words, rounded in one way wherever a person reads them."""

from __future__ import annotations

import math


def percent(share: float) -> str:
    """Return a share in [0, 1] as whole percent, rounded down: what is not certain is never called 100 %.

    ``"unknown"`` for NaN. The report's viewer rounds alike (``layers.js``).
    """
    return "unknown" if math.isnan(share) else f"{math.floor(100 * share + 1e-9)} %"
