"""How sure a pose of an incomplete shape is, by how much worse its best rival fits the same targets."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.poses import AGREE_DEG, turn_deg

#: Log odds of a pose per unit of its margin on one target, and their most. Of 96 pairs of which one lacks a quarter
#: (ants, fish, teddies, people, glasses and chairs at even positions, 69 % right) slopes of 5, 8, 15 and 30 have mean
#: log losses of .54, .53, .60 and .88. `python -m experiments calibrate margins` measures such pairs again.
SLOPE, MOST_CERTAIN = 8.0, 5.0


def rival_margin(turns: FloatArray, energies: FloatArray) -> float:
    """Return by how much, in logarithms of energy, the best pose fits better than its best rival; infinite without.

    Parameters
    ----------
    turns : ndarray, shape (m, 3, 3)
        The best pose first.
    energies : ndarray, shape (m, n)
        Of each pose on each target.
    """
    apart = turn_deg(turns, turns[0]) > AGREE_DEG
    means = np.log(energies).mean(axis=1)
    return float((means[apart] - means[0]).min(initial=np.inf))


def certainty(margin: float, num_targets: int = 1) -> float:
    """Return the chance that a pose is right, by its margin over its best rival on the mean of so many targets.

    Targets err apart from each other, so the log odds grow with the root of their number.
    """
    log_odds = min(SLOPE * np.sqrt(num_targets) * margin, MOST_CERTAIN)
    return float(1.0 / (1.0 + np.exp(-log_odds)))
