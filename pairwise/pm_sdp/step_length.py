"""How far a step may go: the longest size at which every cone keeps a share of the distance to its boundary."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.variables import Direction, DualPoint, PrimalPoint, are_positive, conditional_moments

#: A step shorter than this is no progress.
SHORTEST_STEP = 1e-4
#: Bisection ends when the interval is this share of its upper end.
_PRECISION = 1.0 / 256.0


def longest_primal(data: RelaxationData, point: PrimalPoint, step: Direction, least: float) -> float:
    """Return a size of at most one after which x, slack, G and Y keep at least the share ``least`` of themselves.

    Parameters
    ----------
    data, point, step
        The problem, the point and where it should go.
    least : float
        In [0, 1).
    """
    size = min(_longest_linear(point.x[data.valid], step.x[data.valid], least), 1.0)
    size = min(_longest_linear(point.slack[~data.equality], step.slack[~data.equality], least), size)
    turned = data.lifted.quaternion_change(step.R)

    def keeps(trial: float) -> bool:
        if not are_positive((1.0 - least) * point.Y + trial * turned):
            return False
        moved = (one + trial * change for one, change in zip((point.x, point.B, point.C), steps, strict=True))
        return are_positive(conditional_moments(data, *moved)[1] - least * point.G)

    steps = step.x, step.B, step.C
    return _longest(keeps, size)


def longest_dual(data: RelaxationData, point: DualPoint, step: Direction, least: float) -> float:
    """Return a size of at most one after which beta, F, s and Y keep at least the share ``least`` of themselves.

    Parameters
    ----------
    data, point, step, least
        See :func:`longest_primal`.
    """
    size = min(_longest_linear(point.beta[~data.equality], step.beta[~data.equality], least), 1.0)

    root = np.linalg.inv(point.factor)
    # (F + t dF)^-1 = root^T turns diag(1 / (1 + t rates)) turns^T root
    rates, turns = np.linalg.eigh(root @ step.F @ np.swapaxes(root, 1, 2))
    bends = (step.bend @ (np.swapaxes(root, 1, 2) @ turns)) ** 2

    def keeps(trial: float) -> bool:
        if (1.0 - least + trial * rates).min() <= 0.0 or not are_positive((1.0 - least) * point.Y + trial * step.Y):
            return False
        change = step.ds - trial * (bends @ (1.0 / (1.0 + trial * rates))[..., None])[..., 0]
        return bool(((1.0 - least) * point.s + trial * change >= 0.0)[data.valid].all())

    return _longest(keeps, size)


def _longest(keeps: Callable[[float], bool], size: float) -> float:
    """Return the longest of the sizes up to the given one at which a cone is kept, by bisection."""
    low, high, trial = 0.0, size, size
    while True:
        low, high = (trial, high) if keeps(trial) else (low, trial)
        if high - low <= _PRECISION * high:
            return low
        trial = 0.5 * (low + high)


def _longest_linear(values: FloatArray, changes: FloatArray, least: float) -> float:
    """Return the size after which the first value has the share ``least`` of itself left."""
    slowest = float((changes / values).min(initial=np.inf))
    return (least - 1.0) / slowest if slowest < 0.0 else np.inf
