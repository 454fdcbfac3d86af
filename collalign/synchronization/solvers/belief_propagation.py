"""Choosing one turn per shape: belief propagation on the pairs' costs, and conditional moves that polish it."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray, IntArray

#: A change of labels gains when the cost falls by more than this, nats: less is rounding.
GAIN_TOL = 1e-9

#: Rounds of messages, and of moves, at most; messages have settled when none changes by more.
MAX_ROUNDS, MAX_MOVES, MESSAGE_TOL = 60, 100, 1e-3

#: Part of the old message kept at each round.
DAMPING = 0.4


def propagate_beliefs(
    edges: IntArray,
    costs: FloatArray,
    num_shapes: int,
    *,
    start: FloatArray | None = None,
    fixed: IntArray | None = None,
    max_rounds: int = MAX_ROUNDS,
) -> FloatArray:
    """Return sum-product marginals of the turns, shape (N, L).

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    costs : ndarray, shape (E, L, L)
        Minus log-likelihood of each combination of turns.
    num_shapes : int
    start : ndarray, shape (N, L), optional
        Beliefs to start from; uniform by default.
    fixed : ndarray of int, optional
        Shapes that stay at turn 0: they break the symmetry of the gauge. Their own marginals are what the others say.
    max_rounds : int
        At most; it ends before when no message changes by ``MESSAGE_TOL``.
    """
    count, size = costs.shape[:2]
    likelihood = np.exp(-(costs - costs.min(axis=(1, 2), keepdims=True)))
    kernel = np.concatenate([likelihood, np.swapaxes(likelihood, 1, 2)])
    source, target = edges.T.ravel(), edges[:, ::-1].T.ravel()
    reverse = np.concatenate([np.arange(count, 2 * count), np.arange(count)])
    beliefs = np.full((num_shapes, size), 1.0 / size) if start is None else start.copy()
    is_fixed = np.zeros(num_shapes, dtype=bool)
    is_fixed[fixed if fixed is not None else []] = True
    at_turn_0 = np.where(np.arange(size) == 0, 1.0, 0.0)
    messages = np.zeros((2 * count, size))
    cavity = beliefs[source]
    for _ in range(max_rounds):
        cavity[is_fixed[source]] = at_turn_0
        fresh = np.log(np.maximum((cavity[:, None, :] @ kernel)[:, 0], 1e-300))
        fresh -= fresh.max(axis=1, keepdims=True)
        mixed = fresh if _ == 0 else DAMPING * messages + (1.0 - DAMPING) * fresh
        change = float(np.abs(np.exp(mixed) - np.exp(messages)).max(initial=0.0))
        messages = mixed
        field = _summed(messages, target, num_shapes)
        cavity = _softmax(field[source] - messages[reverse])
        if change < MESSAGE_TOL:
            break
    return _softmax(_summed(messages, target, num_shapes))


def conditional_moves(edges: IntArray, costs: FloatArray, labels: IntArray, *, free: FloatArray) -> IntArray:
    """Return labels that no change of a single shape improves (iterated conditional modes).

    Each round changes an independent set of the shapes that gain most, so that the cost falls at every step.
    """
    labels = labels.copy()
    left, right = edges.T
    span = np.arange(len(edges))
    for _ in range(MAX_MOVES):
        field = _summed(costs[span, :, labels[right]], left, len(labels))
        field += _summed(costs[span, labels[left]], right, len(labels))
        best = np.argmin(field, axis=1)
        shapes = np.arange(len(labels))
        gain = np.where(free, field[shapes, labels] - field[shapes, best], 0.0)
        if gain.max(initial=0.0) <= GAIN_TOL:
            break
        rival = np.zeros(len(labels))
        np.maximum.at(rival, left, gain[right])
        np.maximum.at(rival, right, gain[left])
        moving = (gain > GAIN_TOL) & (gain > rival)
        moving[np.argmax(gain)] = True
        both = moving[left] & moving[right]
        moving[right[both & (gain[right] < gain[left].max(initial=0.0))]] = False
        moving[np.argmax(gain)] = True
        labels = np.where(moving, best, labels)
    return labels


def _summed(values: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """Return the sums of rows (n, L) by owner, shape (count, L)."""
    return np.stack([np.bincount(owner, weights=column, minlength=count) for column in values.T], axis=1)


def _softmax(field: FloatArray) -> FloatArray:
    raised = np.exp(field - field.max(axis=1, keepdims=True))
    return raised / raised.sum(axis=1, keepdims=True)
