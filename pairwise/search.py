"""Search over the rotation block: an even set of rotations, the principal axes, and a second look around the best.

The rotation block of an embedding is its first block; for given rotation of it the other blocks follow in closed form
from the map that the rotation block alone finds best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import OptionsError
from pairwise.local_search import LocalMinima, MatchingCosts, merge, minimise, procrustes
from pairwise.pattern import RotationPattern
from pairwise.problem import Problem
from pairwise.starts import principal_frame, rotation_angles, rotation_set, sign_rotations, small_rotations

#: Largest number of principal-axis starts; 4 in three dimensions.
_MAX_SIGN_STARTS = 16
#: Size of the set of rotations by dimension of the rotation block.
_NUM_ROTATIONS = {1: 1, 2: 48, 3: 160}
_NUM_ROTATIONS_ABOVE = 200
#: The second look: around how many distinct minima, with how many rotations each, by which angle.
_NUM_CENTRES, _NUM_AROUND, _ANGLE_AROUND_RAD = 6, 12, np.deg2rad(15.0)


def rotation_block(pattern: RotationPattern) -> int:
    """Return the size of the first block of R, the one that turns the shape.

    It is the block of determinant +1 where there is one, the first diagonal block of two or three coordinates, or all
    of R.

    Raises
    ------
    OptionsError
        If the block of determinant +1 is not the first one.
    """
    if pattern.special_blocks:
        start, stop = pattern.special_blocks[0]
        if start != 0:
            raise OptionsError("rotation_pattern: the rotation block must come first")
        return stop
    first = len(pattern.components[0])
    return first if first in (2, 3) else pattern.dim


def of_chirality(problem: Problem, *, reflected: bool) -> Problem:
    """Return the problem with the rotation block's determinant fixed to +1.

    For poses of determinant -1 the source's first coordinate is negated: negate the first column of the solutions,
    too (:func:`mirror_rotations`).
    """
    block = rotation_block(problem.pattern)
    pattern = RotationPattern(problem.pattern.mask, ((0, block),))
    source = mirror_points(problem.source) if reflected else problem.source
    return replace(problem, source=read_only(source), pattern=pattern)


def mirror_points(points: FloatArray) -> FloatArray:
    """Return points with the first coordinate negated."""
    mirrored = points.copy()
    mirrored[..., 0] *= -1.0
    return mirrored


#: Negates the first column of matrices: composes a pose with the same mirror.
mirror_rotations = mirror_points


def leading_problem(problem: Problem) -> Problem:
    """Return the problem in the coordinates of the rotation block alone, constant costs included."""
    block = rotation_block(problem.pattern)
    if block == problem.dim:
        return problem
    pattern = RotationPattern(
        read_only(problem.pattern.mask[:block, :block].copy()), problem.pattern.special_blocks[:1]
    )
    return replace(
        problem,
        target=read_only(np.ascontiguousarray(problem.target[:, :block])),
        source=read_only(np.ascontiguousarray(problem.source[:, :block])),
        pattern=pattern,
    )


def search(
    problem: Problem, *, num_rotations: int = 0, seed: int = 0, scale_range: tuple[float, float] | None = None
) -> LocalMinima:
    """Return the local minima that an even set of starts leads to.

    Parameters
    ----------
    problem : Problem
        Of one chirality (:func:`of_chirality`).
    num_rotations : int
        Size of the set of rotations; 0 sets it by the dimension of the rotation block.
    seed : int
        For rotation blocks of more than three dimensions.
    scale_range : pair of float, optional
        Estimate the scale too, within these limits.

    Returns
    -------
    LocalMinima
        Found from ``"axes"``, ``"search"``, or by looking ``"around"`` the best of these.
    """
    lead = leading_problem(problem)
    frames = principal_frame(lead.target, np.ones(lead.num_target)), principal_frame(lead.source, lead.weights)
    axes = sign_rotations(lead.dim, _MAX_SIGN_STARTS, seed=seed)
    even = rotation_set(lead.dim, num_rotations or _NUM_ROTATIONS.get(lead.dim, _NUM_ROTATIONS_ABOVE), seed=seed)
    starts = frames[0] @ np.concatenate([axes, even]) @ frames[1].T
    origins = np.repeat(["axes", "search"], [len(axes), len(even)])
    minima = descend(problem, lead, starts, origins, scale_range=scale_range)
    centres = distinct(minima.rotations[:, : lead.dim, : lead.dim], _ANGLE_AROUND_RAD / 2.0, _NUM_CENTRES)
    around = small_rotations(lead.dim, _NUM_AROUND, _ANGLE_AROUND_RAD, seed=seed)
    rotations = minima.rotations[centres, : lead.dim, : lead.dim]
    starts = (around @ rotations[:, None]).reshape(-1, lead.dim, lead.dim)
    return merge([minima, descend(problem, lead, starts, "around", scale_range=scale_range)])


def descend(
    problem: Problem,
    lead: Problem,
    starts: FloatArray,
    origins: str | NDArray[np.str_],
    *,
    scale_range: tuple[float, float] | None = None,
) -> LocalMinima:
    """Minimise from rotations of the rotation block alone, the other blocks following in closed form."""
    if lead is not problem:
        maps = MatchingCosts(lead).assign(starts, np.ones(len(starts)))
        starts, _ = procrustes(problem, maps)
    return minimise(problem, starts, scale_range=scale_range, origins=origins)


def distinct(rotations: FloatArray, angle_rad: float, num: int) -> IntArray:
    """Return positions of the first ``num`` rotations that are pairwise at least ``angle_rad`` apart, in order."""
    kept: list[int] = []
    for position in range(len(rotations)):
        if len(kept) == num:
            break
        if not kept or rotation_angles(rotations[kept], rotations[position]).min() >= angle_rad:
            kept.append(position)
    return np.array(kept, dtype=np.int64)
