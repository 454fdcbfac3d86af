"""Fits the weights of the confidence: logistic regression on the evidence of many runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from collalign.confidence.pose_model import terms
from data_tools.arrays import BoolArray, FloatArray
from experiments.collections.posed import MIRRORED_DEG

#: Ridge on the weights of standardised evidence: with few collections, weights that chase one of them are no gain.
RIDGE = 3.0
#: Every collection counts as if it had this many shapes.
COLLECTION_WEIGHT = 50.0
_NUM_STEPS = 50


def fit_weights(seen: FloatArray, right: BoolArray, kind: FloatArray) -> tuple[FloatArray, float]:
    """Return weights and constant of the logistic model, by Newton's method (iteratively reweighted least squares).

    Weights of evidence that speaks for a pose are not allowed to be negative: where one would be, it is left out and
    the others are fitted again.

    Parameters
    ----------
    seen : ndarray, shape (n, m)
        What the model weighs.
    right : ndarray of bool, shape (n,)
    kind : ndarray of int, shape (n,)
        Which collection each row is from.

    Returns
    -------
    weights : ndarray, shape (m,)
    constant : float
    """
    num_terms = seen.shape[1]
    centre, spread = seen.mean(axis=0), np.maximum(seen.std(axis=0), 1e-9)
    _, which, counts = np.unique(kind, return_inverse=True, return_counts=True)
    trust = (COLLECTION_WEIGHT / counts)[which]
    used = np.ones(num_terms, dtype=bool)
    while True:
        weights = np.zeros(num_terms)
        weights[used], constant = _newton(((seen - centre) / spread)[:, used], right, trust)
        if not (weights < 0).any():
            break
        used &= weights >= 0
    weights /= spread
    return weights, float(constant - centre @ weights)


def _newton(columns: FloatArray, right: BoolArray, trust: FloatArray) -> tuple[FloatArray, float]:
    design = np.column_stack([columns, np.ones(len(columns))])
    # The least on the constant as well: without it there is no maximum where all poses are right.
    ridge = RIDGE * np.diag([*np.ones(columns.shape[1]), 1e-6])
    solution = np.zeros(design.shape[1])
    for _ in range(_NUM_STEPS):
        chance = 1.0 / (1.0 + np.exp(-design @ solution))
        gradient = design.T @ (trust * (right - chance)) - ridge @ solution
        hessian = design.T @ (design * (trust * chance * (1.0 - chance))[:, None]) + ridge
        step = np.linalg.solve(hessian, gradient)
        solution = solution + step
        if np.abs(step).max() < 1e-10:
            break
    return solution[:-1], float(solution[-1])


def left_out(seen: FloatArray, right: BoolArray, kind: FloatArray) -> FloatArray:
    """Return the probability of each row by weights that were fitted without its collection, shape (n,)."""
    found = np.empty(len(right))
    for one in np.unique(kind):
        out = kind == one
        weights, constant = fit_weights(seen[~out], right[~out], kind[~out])
        found[out] = 1.0 / (1.0 + np.exp(-(seen[out] @ weights + constant)))
    return found


def training_rows(
    records: Mapping[str, Mapping[str, Any]],
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Return what the model weighs, truth and collection of all shapes that are no intruders and have evidence.

    Poses of the wrong chirality are left out: the evidence is about rotations, and sides are judged apart from it.
    """
    parts = []
    for number, record in enumerate(records.values()):
        known = ~np.isnan(terms(record["evidence"])).any(axis=1)
        used = ~record["intruder"] & known & (record["error_deg"] != MIRRORED_DEG)
        parts.append((record["evidence"][used], record["right"][used], np.full(used.sum(), number)))
    evidence, right, kind = (np.concatenate(part) for part in zip(*parts, strict=True))
    return terms(evidence), right, kind
