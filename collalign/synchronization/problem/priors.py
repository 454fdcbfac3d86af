"""Every number that synchronization was tuned by, in one table."""

from __future__ import annotations

from typing import NamedTuple


class Priors(NamedTuple):
    """What holds where pairs are too few to say, and how far beliefs are believed.

    Set on the planted graphs of ``python -m experiments synchronization``, on other seeds than its own (of the shapes
    stated at .95 at least 99 % were to be right). No public collection was looked at for that;
    ``python -m experiments calibrate model`` measures on three of them what the first priors stand for.
    """

    noise_rad: float = 0.1
    """Prior noise per axis, radians, ..."""
    noise_pairs: float = 3.0
    """... and the number of pairs that it counts for."""
    noise_range_rad: tuple[float, float] = (1e-5, 0.35)
    """Noise per axis is kept between these."""
    outliers: float = 0.1
    """Prior share of pairs without any right candidate, ..."""
    outlier_pairs: float = 4.0
    """... and the number of pairs that it counts for."""
    outlier_range: tuple[float, float] = (1e-3, 0.9)
    """That share is kept between these."""
    log_odds: float = 1.5
    """Prior log-odds of a pair's lowest energy against another candidate of median energy, ..."""
    precision: float = 1.0
    """... and the precision of either half of it."""
    most_log_odds: tuple[float, float] = (6.0, 50.0)
    """Largest log-odds of the best candidate, and per unit of log-energy."""
    energy_factor: float = 100.0
    """Energies of pairs count within this factor of their median, either way."""
    spent_share: float = 0.8
    """Most of the right candidates that the frames may use up, when degrees of freedom are counted."""
    label_noise_factors: tuple[float, float] = (2.0, 3.0)
    """Noise is this many times larger where rotations are chosen, with one candidate per pair and with several:
    frames fitted to one choice of candidates fit their noise too, which would count as evidence for the choice."""
    own_pose: float = 0.9
    """How probable a shape's own pose is where beliefs start, ..."""
    other_hypotheses: float = 0.1
    """... and all its other rotations together."""
    explained_share: float = 0.8
    """A shape of which this share of the pairs is explained has no rotations but the common ones."""
    flipped: float = 0.1
    """How many pairs, of one more, are taken to be wrong by each common rotation where none is seen."""
    rare_flip: float = 0.003
    """Common rotations by which fewer pairs than this are wrong are left out of their costs."""
    enough_signal: float = 1.5
    """A signal of the graph below this makes beliefs overconfident; confidences shrink, to half without a signal."""
    enough_pairs: float = 2.6
    """The same for the evidence of a shape's own pairs."""


#: The numbers in use.
PRIORS = Priors()
