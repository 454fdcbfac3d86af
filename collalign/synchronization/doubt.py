"""How far synchronized poses can be trusted: beliefs about rotations, and how much the pairs can say at all."""

from __future__ import annotations

import numpy as np

from collalign.products.pair import MAX_ALTERNATIVES, Alternative
from collalign.synchronization.problem.graph import degrees
from collalign.synchronization.problem.priors import PRIORS
from collalign.synchronization.solvers.search import State
from data_tools.arrays import BoolArray, FloatArray

#: No confidence is stated beyond this: the model itself may be wrong.
MOST_CONFIDENT = 0.999


def assess(
    state: State, frames: FloatArray, free: BoolArray
) -> tuple[FloatArray, list[tuple[Alternative, ...]]]:
    """Return the doubts about an answer: of one connected group the confidence of each pose and its alternatives.

    Parameters
    ----------
    state : State
        The answer.
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
    beliefs = np.minimum(state.beliefs[:, 0], MOST_CONFIDENT)
    confidence = beliefs * (0.5 + 0.5 * np.minimum(1.0, evidence(state)))
    confidence[~free] = 1.0
    return confidence, pose_alternatives(state, frames)


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
        chances = np.concatenate([[max(1.0 - rates.sum(), 0.0)], rates])[None] / max(
            1.0, rates.sum()
        )
    size = (chances > 0).sum(axis=1)
    power = float(
        np.mean(
            np.where(
                size > 1, (size * (chances**2).sum(axis=1) - 1.0) / np.maximum(size - 1, 1), 1.0
            )
        )
    )
    degree = 2.0 * graph.num_edges / graph.num_shapes
    signal = power * explained.mean() ** 2 * max(degree - 1.0, 0.0)
    own = power * np.maximum(degrees(graph, explained) - 1.0, 0.0)
    return np.minimum(signal / PRIORS.enough_signal, own / PRIORS.enough_pairs)


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
        order = [
            a
            for a in np.argsort(-beliefs[1:], kind="stable") + 1
            if state.alternatives.offered[shape, a]
        ]
        rotations = state.alternatives.rotations[shape]
        found.append(
            tuple(
                Alternative(
                    rotation=(frames[shape] @ rotations[a]).T,
                    log_odds=float(
                        np.log(max(beliefs[0], 1e-300)) - np.log(max(beliefs[a], 1e-300))
                    ),
                )
                for a in order[:MAX_ALTERNATIVES]
            )
        )
    return found
