"""Which shapes differ so much in size from the others that their files are probably in another unit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

#: Shapes so many times larger or smaller than the median one may be in another unit.
ODD_FACTOR = 8.0


def odd_ratios(sizes: Mapping[str, float]) -> dict[str, float]:
    """Return by what factor shapes differ from the median one, of those that differ by :data:`ODD_FACTOR` or more.

    Parameters
    ----------
    sizes : mapping of str to float
        A length of each shape in the unit of its file.
    """
    middle = float(np.median(list(sizes.values()))) if sizes else 1.0
    ratios = {name: size / middle for name, size in sizes.items() if size > 0 and middle > 0}
    return {name: ratio for name, ratio in ratios.items() if max(ratio, 1.0 / ratio) >= ODD_FACTOR}
