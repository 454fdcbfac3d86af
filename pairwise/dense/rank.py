"""The last stage of a match: every candidate is refined on dense points, and both energies rank the candidates.

The samples' energy knows that a match is one-to-one but sees few points; the dense points' energy (closest points
both ways, invariants included) sees the whole shape but lets points share a counterpart. Each is a sum of squares
whose noise level is unknown and differs from shape to shape, so each says by its *logarithm* how likely a pose is
(the profile likelihood of the noise level), and the two together by the sum of the logarithms: the candidates are
ranked by the product of both energies. On rigid shapes (teeth) and on bent ones (ants, teddy bears) the product picks
the right pose more often than the samples' energy alone; the dense energy alone loses on bent shapes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from data_tools.errors import InputError, OptionsError
from pairwise.dense.points import DensePoints
from pairwise.dense.refine import RefinedPose, refine_pose
from pairwise.problem.problem import Problem
from pairwise.results import Candidate

#: Normals pull bent limbs off the pose that most of a shape agrees on; more steps than these let bent shapes drift.
_NORMAL_WEIGHT, _MAX_ITERATIONS = 0.0, 8
#: Dense points of one shape: points (l, d), with their normals or not.
DenseLike: TypeAlias = "DensePoints | ArrayLike | tuple[ArrayLike, ArrayLike]"


def dense_pair(dense: tuple[DenseLike, DenseLike], problem: Problem) -> tuple[DensePoints, DensePoints]:
    """Check what callers give as dense points of target and source.

    Raises
    ------
    InputError
        If they are not points of the dimension of the problem's rotation block.
    OptionsError
        If they are no pair.
    """
    if not isinstance(dense, tuple | list) or len(dense) != 2:
        raise OptionsError("dense: expected a pair (target, source) of dense points")
    block = problem.pattern.rotation_block
    checked = []
    for value, role in zip(dense, ("target", "source"), strict=True):
        cloud = _as_dense(value)
        if cloud.points.shape[1] != block:
            raise InputError(f"dense points of the {role}: expected {block} columns, got {cloud.points.shape[1]}")
        checked.append(cloud)
    return checked[0], checked[1]


def _as_dense(value: DenseLike) -> DensePoints:
    if isinstance(value, DensePoints):
        return value
    if isinstance(value, tuple) and len(value) == 2:
        return DensePoints.from_user(value[0], value[1])
    return DensePoints.from_user(value)


def refine_candidates(
    candidates: Iterable[Candidate],
    problem: Problem,
    dense: tuple[DensePoints, DensePoints],
) -> tuple[Candidate, ...]:
    """Return the candidates with their refined poses, ranked by the product of both energies.

    Parameters
    ----------
    candidates : iterable of Candidate
    problem : Problem
    dense : pair of DensePoints
        Of target and source, in the coordinates of the rotation block and the units of the samples.

    Returns
    -------
    tuple of Candidate
    """
    refined = [replace(c, refined=_refine(c, problem, dense)) for c in candidates]
    return tuple(sorted(refined, key=_both_energies))


def _refine(candidate: Candidate, problem: Problem, dense: tuple[DensePoints, DensePoints]) -> RefinedPose:
    block = problem.pattern.rotation_block
    return refine_pose(
        *dense,
        candidate.R_target_source[:block, :block],
        estimate_scale=False,
        normal_weight=_NORMAL_WEIGHT,
        max_iterations=_MAX_ITERATIONS,
    )


def _both_energies(candidate: Candidate) -> tuple[float, float]:
    """Return what candidates are sorted by; exact matches of the samples differ on the dense points at most."""
    dense_energy = np.inf if candidate.refined is None else candidate.refined.energy
    return candidate.energy * dense_energy, dense_energy
