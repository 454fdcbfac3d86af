"""How far a step may go: the longest size at which every cone keeps a share of the distance to its boundary."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.pm_sdp.data import RelaxationData
from pairwise.pm_sdp.variables import Direction, DualPoint, PrimalPoint

#: A step shorter than this is no progress.
SHORTEST_STEP = 1e-4


def longest_primal(data: RelaxationData, point: PrimalPoint, step: Direction, least: float) -> float:
    """Return a size of at most one after which x, slack, G and Y keep at least the share ``least`` of themselves.

    Parameters
    ----------
    data, point, step
        The problem, the point and where it should go.
    least : float
        In [0, 1).
    """
    from pairwise.pm_sdp.cone_kernels import longest_block_step, longest_primal_step

    size = min(_longest_linear(point.x[data.valid], step.x[data.valid], least), 1.0)
    size = min(_longest_linear(point.slack[~data.equality], step.slack[~data.equality], least), size)
    size = longest_block_step(point.Y, data.lifted.quaternion_change(step.R), least, size)
    return longest_primal_step(
        (point.x, point.B, point.C, point.G), data.valid, (step.x, step.B, step.C), least, size
    )


def longest_dual(data: RelaxationData, point: DualPoint, step: Direction, least: float) -> float:
    """Return a size of at most one after which beta, F, s and Y keep at least the share ``least`` of themselves.

    Parameters
    ----------
    data, point, step, least
        See :func:`longest_primal`.
    """
    from pairwise.pm_sdp.cone_kernels import longest_block_step, longest_dual_step

    size = min(_longest_linear(point.beta[~data.equality], step.beta[~data.equality], least), 1.0)
    size = longest_block_step(point.Y, step.Y, least, size)
    return longest_dual_step((point.F, point.s), data.valid, (step.F, step.bend, step.ds), least, size)


def _longest_linear(values: FloatArray, changes: FloatArray, least: float) -> float:
    """Return the size after which the first value has the share ``least`` of itself left."""
    slowest = float((changes / values).min(initial=np.inf))
    return (least - 1.0) / slowest if slowest < 0.0 else np.inf
