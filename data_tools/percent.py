"""Shares and lists in words, rounded and shortened in one way wherever a person reads them."""

from __future__ import annotations

import math
from collections.abc import Sequence

#: Names that a sentence lists; of more shapes the number is said.
MAX_NAMED = 8


def percent(share: float) -> str:
    """Return a share in [0, 1] as whole percent, rounded down: what is not certain is never called 100 %.

    ``"unknown"`` for NaN. The report's viewer rounds alike (``layers.js``).
    """
    return "unknown" if math.isnan(share) else f"{math.floor(100 * share + 1e-9)} %"


def listed(names: Sequence[str]) -> str:
    """Return names as a list in a sentence, shortened to :data:`MAX_NAMED`."""
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return ", ".join(names[:MAX_NAMED]) + more
