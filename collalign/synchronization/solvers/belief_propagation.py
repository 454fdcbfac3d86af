"""Choosing one turn per shape: belief propagation on the pairs' costs."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray

#: Rounds of messages at most; they have settled when none changes by more.
MAX_ROUNDS, MESSAGE_TOL = 60, 1e-3

#: Part of the old message kept at each round.
DAMPING = 0.4


def propagate_beliefs(edges: IntArray, costs: FloatArray, *, start: FloatArray, fixed: BoolArray) -> FloatArray:
    """Return sum-product marginals of the turns, shape (N, L).

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    costs : ndarray, shape (E, L, L)
        Minus log-likelihood of each combination of turns.
    start : ndarray, shape (N, L)
        Beliefs to start from.
    fixed : ndarray of bool, shape (N,)
        Shapes that stay at turn 0: they break the symmetry of the gauge. Their own marginals are what the others say.
    """
    count, size = costs.shape[:2]
    likelihood = np.exp(-(costs - costs.min(axis=(1, 2), keepdims=True)))
    kernel = np.concatenate([likelihood, np.swapaxes(likelihood, 1, 2)])
    source, target = edges.T.ravel(), edges[:, ::-1].T.ravel()
    reverse = np.concatenate([np.arange(count, 2 * count), np.arange(count)])
    at_turn_0 = np.where(np.arange(size) == 0, 1.0, 0.0)
    messages = np.zeros((2 * count, size))
    cavity = start[source]
    for _ in range(MAX_ROUNDS):
        cavity[fixed[source]] = at_turn_0
        fresh = np.log(np.maximum((cavity[:, None, :] @ kernel)[:, 0], 1e-300))
        fresh -= fresh.max(axis=1, keepdims=True)
        mixed = fresh if _ == 0 else DAMPING * messages + (1.0 - DAMPING) * fresh
        change = float(np.abs(np.exp(mixed) - np.exp(messages)).max(initial=0.0))
        messages = mixed
        field = _summed(messages, target, len(start))
        cavity = _softmax(field[source] - messages[reverse])
        if change < MESSAGE_TOL:
            break
    return _softmax(_summed(messages, target, len(start)))


def _summed(values: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Return the sums of rows (n, L) by owner, shape (count, L)."""
    return np.stack([np.bincount(owner, weights=column, minlength=count) for column in values.T], axis=1)


def _softmax(field: FloatArray) -> FloatArray:
    raised = np.exp(field - field.max(axis=1, keepdims=True))
    return raised / raised.sum(axis=1, keepdims=True)
