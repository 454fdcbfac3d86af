"""Synthetic matching problems: random points and a rotated, shuffled, noisy copy of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_tools.arrays import BoolArray, IntArray
from data_tools.rotations import random_rotation
from pairwise.problem import Problem


def planted_problem(
    rng: np.random.Generator,
    num_target: int,
    num_source: int,
    dim: int,
    *,
    noise: float = 0.1,
    num_candidates: int = 0,
    group: str = "SO",
    **options: Any,
) -> Problem:
    """Return the problem of Maron et al. 2016, figure 5: Q uniform in the unit cube, P = R^T Q X plus noise.

    Parameters
    ----------
    rng : numpy.random.Generator
    num_target, num_source : int
        Points of Q, and how many of them P has.
    dim : int
    noise : float
        Standard deviation of the Gaussian noise of each coordinate.
    num_candidates : int
        Target points that each source point may match: its own, and others at random; 0 for all.
    group : str
        "SO" or "O", from which R is drawn uniformly.
    **options
        More of what :meth:`Problem.from_user` takes.
    """
    target = rng.random((num_target, dim))
    matched = rng.permutation(num_target)[:num_source]
    source = target[matched] @ random_rotation(rng, dim, group=group)
    source += noise * rng.standard_normal((num_source, dim))
    allowed = (
        random_candidates(rng, num_target, matched, num_candidates) if num_candidates else None
    )
    return Problem.from_user(target, source, allowed=allowed, group=group, **options)


def random_candidates(
    rng: np.random.Generator, num_target: int, matched: IntArray, num: int
) -> BoolArray:
    """Return which target points each source point may match, shape (n, k): its own and ``num`` - 1 or so others."""
    allowed = np.zeros((num_target, len(matched)), dtype=bool)
    for column, row in enumerate(matched):
        allowed[rng.choice(num_target, num - 1, replace=False), column] = True
        allowed[row, column] = True
    return allowed
