"""Checks what ``collalign certify`` left: a lower bound of the energy of all arrangements of a result's shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.output.verification import CheckedCollection
from data_tools.arrays import as_floats, as_indices, as_rotations
from data_tools.errors import InputError
from pairwise.certificates.verify import CLAIM_TOL
from pairwise.certificates.verify_cells import tilted_bound
from pairwise.certificates.verify_joint import gram_bound
from pairwise.local.local_search import MatchingCosts
from pairwise.problem.problem import Problem

#: The arrays of the file beside the samples.
PROOF_ARRAYS = ("edges", "frames", "tilts", "diagonal", "num_cells", "depths", "bound")
#: Numbers beyond this are refused: their products would overflow.
_LARGEST = 1e50


def check_collection(
    arrays: Mapping[str, NDArray[Any]], num_shapes: int, problem: Callable[[int, int], Problem]
) -> CheckedCollection:
    """Say what a proof of a collection proves.

    Parameters
    ----------
    arrays : mapping of name to array
        :data:`PROOF_ARRAYS`; nothing about them is believed.
    num_shapes : int
    problem : callable
        The problem of two shapes, by their numbers; it refuses pairs that are none of the result.
    """
    try:
        return _check(arrays, num_shapes, problem)
    except (InputError, FloatingPointError, OverflowError, np.linalg.LinAlgError) as error:
        nothing = float("nan")
        return CheckedCollection(num_shapes=num_shapes, num_pairs=0, proven=nothing, energy=nothing, fault=str(error))


def _check(
    arrays: Mapping[str, NDArray[Any]], num_shapes: int, problem: Callable[[int, int], Problem]
) -> CheckedCollection:
    edges = as_indices(arrays["edges"], "edges", upper=num_shapes, shape=(None, 2))
    distinct = {frozenset(edge) for edge in edges.tolist() if edge[0] != edge[1]}
    if not 0 < len(edges) == len(distinct):
        raise InputError("edges: no pairs, a pair twice, or one of a shape with itself")
    tilts = as_floats(arrays["tilts"], "tilts", shape=(len(edges), 3, 3))
    diagonal = as_floats(arrays["diagonal"], "diagonal", shape=(num_shapes, 3, 3))
    frames = as_rotations(as_floats(arrays["frames"], "frames", shape=(num_shapes, 3, 3)), "frames")
    if max(np.abs(tilts).max(), np.abs(diagonal).max()) > _LARGEST:
        raise InputError("tilts or diagonal: numbers that are too large")
    problems = [problem(i, j) for i, j in edges.tolist()]
    sides = 1 if problems[0].pattern.special_blocks else 2
    if sides == 1 and (np.linalg.det(frames) < 0.0).any():
        raise InputError("frames: a shape is mirrored, which the result's group forbids")
    depths = as_indices(arrays["depths"], "depths", upper=256, shape=(None,))
    counts = as_indices(arrays["num_cells"], "num_cells", upper=len(depths) + 1, shape=(len(edges), sides))
    if counts.sum() != len(depths):
        raise InputError("num_cells: they are not as many as depths")
    cells = np.split(depths, np.cumsum(counts.ravel())[:-1])
    with np.errstate(over="raise", invalid="raise"):
        pair_sum, energy = 0.0, 0.0
        for e, (one, tilt) in enumerate(zip(problems, tilts, strict=True)):
            i, j = edges[e]
            pair_sum += tilted_bound(one, tilt, cells[sides * e : sides * (e + 1)])
            rotation = frames[i].T @ frames[j]
            energy += one.energy(rotation, MatchingCosts(one).assign(rotation[None])[0])
        proven = max(0.0, pair_sum + gram_bound(edges, tilts, diagonal))  # no energy is negative
    claim = float(as_floats(arrays["bound"], "bound", shape=()))
    if not proven >= claim - CLAIM_TOL * max(energy, abs(claim)):
        raise InputError(f"it claims the bound {claim:.12g} but proves {proven:.12g}")
    return CheckedCollection(
        num_shapes=num_shapes,
        num_pairs=len(edges),
        proven=proven,
        energy=energy,
    )
