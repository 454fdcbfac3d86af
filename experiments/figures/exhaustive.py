"""Exhaustive search: alternating minimisation from very many rotations, each run by itself."""

from __future__ import annotations

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.local_search import MatchingCosts, energies_of, procrustes
from pairwise.problem import Problem
from pairwise.rotation_sets import rotation_set


def exhaustive_energies(problem: Problem, num: int) -> FloatArray:
    """Return the energies of the local minima that an even set of O(d) leads to, one per start.

    Parameters
    ----------
    problem : Problem
        Of the group O(d), without blocks.
    num : int
        Starts, half of them reflections.
    """
    rotations = rotation_set(problem.dim, num // 2)
    mirrored = rotations * np.r_[-1.0, np.ones(problem.dim - 1)]
    return minimise_each(problem, np.concatenate([rotations, mirrored]))


def minimise_each(problem: Problem, rotations: FloatArray) -> FloatArray:
    """Return the energies that alternating minimisation ends at, every start by itself: runs that meet go on apart.

    Parameters
    ----------
    problem : Problem
    rotations : ndarray, shape (m, d, d)

    Returns
    -------
    ndarray, shape (m,)
    """
    rotations = rotations.copy()
    costs = MatchingCosts(problem)
    maps = np.full((len(rotations), problem.num_source), -1)
    moving = np.arange(len(rotations))
    while len(moving):
        new = costs.assign(rotations[moving])
        changed = (new != maps[moving]).any(axis=1)
        maps[moving] = new
        rotations[moving] = procrustes(problem, new)
        moving = moving[changed]
    return energies_of(problem, rotations, maps)
