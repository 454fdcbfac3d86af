"""How far synchronized poses can be trusted: beliefs about rotations, and whether other likely answers agree."""

from __future__ import annotations

import numpy as np

from collalign.products.pair import MAX_ALTERNATIVES, Alternative
from collalign.synchronization.problem.graph import degrees
from collalign.synchronization.problem.priors import PRIORS
from collalign.synchronization.solvers.hypotheses import SAME_ROTATION
from collalign.synchronization.solvers.search import State, common_costs
from data_tools.arrays import BoolArray, FloatArray

#: No confidence is stated beyond this: the model itself may be wrong.
MOST_CONFIDENT = 0.999

#: Pairs of rotations that are compared at once: more would only take memory.
_MOST_COMPARED = 2048**2


def assess(
    states: list[State], frames: FloatArray, free: BoolArray
) -> tuple[FloatArray, list[tuple[Alternative, ...]]]:
    """Return the doubts about an answer: of one connected group the confidence of each pose and its alternatives.

    Parameters
    ----------
    states : list of State
        What the starts led to, the answer first.
    frames : ndarray, shape (N, d, d)
        The reported frames: the answer's, refined.
    free : ndarray of bool, shape (N,)
        Shapes that are not fixed by hand; the others are certain.

    Returns
    -------
    confidence : ndarray, shape (N,)
    alternatives : list of tuple of Alternative
        Per shape.
    """
    best = states[0]
    confidence = beliefs_of_answers(states) * (0.5 + 0.5 * np.minimum(1.0, evidence(best)))
    confidence[~free] = 1.0
    return confidence, pose_alternatives(best, frames)


def evidence(state: State) -> FloatArray:
    """Return how much the pairs can say about each pose, in units of what makes beliefs trustworthy, shape (N,).

    A pair chooses among m alternatives of probabilities ``pi``: its candidates, or the common rotations. The squared
    correlation between what it says and what is right is ``(m sum pi^2 - 1) / (m - 1)``, the second eigenvalue,
    squared, of this channel. Where only a share e of the pairs is explained the eigenvalue falls by e: the others say
    nothing. The signal of the graph is this times the mean degree less one. Below one no method can do better than
    chance (Kesten and Stigum 1966). A shape's own evidence is the squared correlation times the number of its
    explained pairs less one. The smaller of both counts.
    """
    model = state.model
    graph = model.graph
    explained = state.alternatives.explained
    chances = np.exp(model.log_prior)
    if graph.candidates.shape[1] == 1:
        rates = state.alternatives.rates
        chances = np.concatenate([[max(1.0 - rates.sum(), 0.0)], rates])[None] / max(1.0, rates.sum())
    size = (chances > 0).sum(axis=1)
    power = float(np.mean(np.where(size > 1, (size * (chances**2).sum(axis=1) - 1.0) / np.maximum(size - 1, 1), 1.0)))
    degree = 2.0 * graph.num_edges / graph.num_shapes
    signal = power * explained.mean() ** 2 * max(degree - 1.0, 0.0)
    own = power * np.maximum(degrees(graph, explained) - 1.0, 0.0)
    return np.minimum(signal / PRIORS.enough_signal, own / PRIORS.enough_pairs)


def beliefs_of_answers(states: list[State]) -> FloatArray:
    """Return the probability that each pose is right relative to its group, shape (N,).

    The belief in the reported rotation, times the share of the likely answers, by their costs, that agree with it.
    """
    best = states[0]
    costs = common_costs(states)
    share = np.exp(-PRIORS.evidence_part * np.maximum(costs - costs[0], 0.0))
    agree = np.array([agreement(best.frames, state.frames) for state in states])
    supported = share @ agree / share.sum()
    return np.minimum(best.beliefs[:, 0] * supported, MOST_CONFIDENT)


def agreement(frames: FloatArray, others: FloatArray) -> BoolArray:
    """Return for each shape whether two answers agree, up to the one rotation that most shapes agree about."""
    rotations = (np.swapaxes(frames, 1, 2) @ others).reshape(len(frames), -1)
    most = np.zeros(len(frames), dtype=bool)
    rows = max(1, _MOST_COMPARED // max(1, len(frames)))
    for first in range(0, len(frames), rows):
        apart = 2.0 * frames.shape[-1] - 2.0 * rotations[first : first + rows] @ rotations.T
        close = apart <= SAME_ROTATION
        best = close[np.argmax(close.sum(axis=1))]
        if best.sum() > most.sum():
            most = best
    return most


def pose_alternatives(state: State, frames: FloatArray) -> list[tuple[Alternative, ...]]:
    """Return for each shape its most probable other poses with their log-odds.

    Parameters
    ----------
    state : State
    frames : ndarray, shape (N, d, d)
        The reported frames, in the gauge of the report.
    """
    found = []
    for shape, beliefs in enumerate(state.beliefs):
        order = [a for a in np.argsort(-beliefs[1:], kind="stable") + 1 if state.alternatives.offered[shape, a]]
        rotations = state.alternatives.rotations[shape]
        found.append(
            tuple(
                Alternative(
                    rotation=(frames[shape] @ rotations[a]).T,
                    log_odds=float(np.log(max(beliefs[0], 1e-300)) - np.log(max(beliefs[a], 1e-300))),
                )
                for a in order[:MAX_ALTERNATIVES]
            )
        )
    return found
