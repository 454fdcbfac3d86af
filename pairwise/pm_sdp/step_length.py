"""How far a step may go: concave margins along it, and the search for the longest step that keeps a margin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.variables import (
    Direction,
    DualPoint,
    PrimalPoint,
    conditional_moments,
    quaternion_slopes,
    slack_change,
)

#: Factor between two trial sizes of a step.
_BACKTRACK = 0.6

#: A chord may end at its own outside end, but for rounding errors; the next trial is at most this share of it.
_CHORD_LIMIT = 0.99

#: A step shorter than this is no progress.
SHORTEST_STEP = 1e-4


class PrimalRay:
    """How far a primal step can go: a concave margin, one at the point itself and zero on the cones' boundary."""

    def __init__(self, data: RelaxationData, point: PrimalPoint, step: Direction) -> None:
        self.data, self.point, self.step = data, point, step
        open_rows = ~data.equality
        x_rates = step.x[data.valid] / point.x[data.valid]
        self.slowest = min(
            float(x_rates.min()),
            _rate(step.slack[open_rows], point.slack[open_rows]),
            _slowest_block(point.Y_roots, quaternion_slopes(data, step.R)),
        )

    def margin(self, size: float) -> float:
        """Return the smallest share of the point's own distance to the boundary that is left after the step."""
        data, point, step = self.data, self.point, self.step
        linear = 1.0 + size * self.slowest
        if linear <= 0.0:
            return linear
        _, G = conditional_moments(data, point.x + size * step.x, point.B + size * step.B, point.C + size * step.C)
        inverse = point.inverse_factor
        return min(linear, float(np.linalg.eigvalsh(inverse @ G @ np.swapaxes(inverse, 1, 2)).min()))


class DualRay:
    """How far a dual step can go; see :class:`PrimalRay`."""

    def __init__(self, data: RelaxationData, point: DualPoint, step: Direction) -> None:
        self.data, self.point = data, point
        open_rows = ~data.equality
        slowest = min(_rate(step.beta[open_rows], point.beta[open_rows]), _slowest_block(point.Y_roots, step.Y))
        inverse = point.inverse_factor
        self.rates, vectors = np.linalg.eigh(inverse @ step.F @ np.swapaxes(inverse, 1, 2))
        self.slowest = min(slowest, float(self.rates.min()))
        bend = -step.u[:, None, :] - point.mean @ step.F
        whitened = bend @ (np.swapaxes(inverse, 1, 2) @ vectors)
        self.squares = whitened * whitened
        self.change = slack_change(data, point, step)

    def margin(self, size: float) -> float:
        """Return the smallest share of the point's own distance to the boundary that is left after the step."""
        linear = 1.0 + size * self.slowest
        if linear <= 0.0:
            return linear
        curved = (self.squares @ (1.0 / (1.0 + size * self.rates))[..., None])[..., 0]
        left = 1.0 + (size * self.change - size * size * curved) / self.point.s
        return min(linear, float(left[self.data.valid].min()))


def _slowest_block(roots: tuple[FloatArray, ...], slopes: tuple[FloatArray, ...]) -> float:
    """Return the fastest relative decrease of an eigenvalue of the blocks."""
    rates = [float(np.linalg.eigvalsh(r @ slope @ r.T)[0]) for r, slope in zip(roots, slopes, strict=True)]
    return min(rates, default=np.inf)


def _rate(change: FloatArray, at: FloatArray) -> float:
    return float((change / at).min()) if len(at) else np.inf


def longest_step(margin: Callable[[float], float], slowest: float, least: float) -> float:
    """Return a size of at most one at which a concave margin, one at zero, is at least ``least``.

    Parameters
    ----------
    margin : callable
        The margin of a size.
    slowest : float
        The margin is at most ``1 + size * slowest``.
    least : float
        In [0, 1).
    """
    trial = 1.0 if slowest > least - 1.0 else (least - 1.0) / slowest
    value = margin(trial)
    if value >= least:
        return trial
    while trial > SHORTEST_STEP:
        outside, outside_value = trial, value
        chord = outside * (1.0 - least) / (1.0 - outside_value)
        trial = min(max(chord, _BACKTRACK * outside), _CHORD_LIMIT * outside)
        value = margin(trial)
        if value >= least:
            return trial + (outside - trial) * (value - least) / (value - outside_value)
    return 0.0
