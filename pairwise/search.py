"""Search over the rotation block: an even set of rotations screened cheaply, the principal axes, a second look.

The rotation block of an embedding is its first block; for given rotation of it the other blocks follow in closed form
from the map that the rotation block alone finds best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import OptionsError
from pairwise.local_search import RIGID, Freedom, LocalMinima, MatchingCosts, merge, minimise, similarities
from pairwise.pattern import RotationPattern
from pairwise.problem import Problem
from pairwise.screening import screen
from pairwise.starts import principal_frame, rotation_set, sign_rotations, small_rotations

#: Largest number of principal-axis starts; 4 in three dimensions.
_MAX_SIGN_STARTS = 16
#: Size of the set of rotations by dimension of the rotation block, and above.
_NUM_ROTATIONS = {1: 1, 2: 96, 3: 500}
_NUM_ROTATIONS_ABOVE = 500
#: Screened rotations closer than this are one.
_SAME_RAD = np.deg2rad(4.0)
#: Share of the rotations that meet exact assignment, for so many steps; share of these that are minimised to the end.
_TRIED, _TRIAL_STEPS, _KEPT = 0.16, 2, 0.25
_LEAST_TRIED, _LEAST_KEPT = 20, 12
#: Steps of nearest-neighbour ICP where a shift is estimated as well.
_SHIFTED_STEPS = 6
#: The second look: around how many distinct minima, up to which multiple of the least energy, with how many rotations
#: each, by which angle.
_NUM_CENTRES, _CENTRE_FACTOR, _NUM_AROUND, _ANGLE_AROUND_RAD = 6, 1.25, 12, np.deg2rad(15.0)


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
    """Return the problem with the rotation block's determinant fixed to +1; itself where the group fixes it already.

    For poses of determinant -1 the source's first coordinate is negated: negate the first column of the solutions,
    too (:func:`mirror_rotations`).
    """
    if problem.pattern.special_blocks:
        return problem
    pattern = RotationPattern(problem.pattern.mask, ((0, rotation_block(problem.pattern)),))
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


def search(problem: Problem, *, num_rotations: int = 0, seed: int = 0, freedom: Freedom = RIGID) -> LocalMinima:
    """Return the local minima that an even set of rotations leads to: :func:`explore`, then :func:`look_around`.

    Parameters
    ----------
    problem : Problem
        Of one chirality (:func:`of_chirality`).
    num_rotations : int
        Size of the set of rotations; 0 sets it by the dimension of the rotation block.
    seed : int
        For rotation blocks of more than three dimensions.
    freedom : Freedom
        What is estimated beside the rotation.
    """
    minima = explore(problem, num_rotations=num_rotations, seed=seed, freedom=freedom)
    return look_around(problem, minima, float(minima.energies[0]), seed=seed, freedom=freedom)


def explore(problem: Problem, *, num_rotations: int = 0, seed: int = 0, freedom: Freedom = RIGID) -> LocalMinima:
    """Return local minima found from the principal axes and an even set of rotations; parameters as :func:`search`.

    All rotations take a step of nearest-neighbour ICP; the most promising distinct ones, two steps with exact
    assignment; the best distinct ones of these are minimised to the end. The set is laid in the frames of the
    principal axes, so that the answer turns with the points.
    """
    lead = leading_problem(problem)
    num = num_rotations or _NUM_ROTATIONS.get(lead.dim, _NUM_ROTATIONS_ABOVE)
    even = rotation_set(lead.dim, num, seed=seed)
    axes = sign_rotations(lead.dim, _MAX_SIGN_STARTS, seed=seed)
    if lead.pattern.mask.all():
        ones = np.ones(lead.num_target)
        frames = principal_frame(lead.target, ones), principal_frame(lead.source, lead.weights)
        axes, even = (frames[0] @ starts @ frames[1].T for starts in (axes, even))
    else:
        even = np.concatenate([sign_rotations(lead.dim, num, seed=seed), lead.pattern.project(even)])
    if freedom.translate:
        screened, shifts, _ = _screen_shifted(lead, even, freedom)
    else:
        screened, shifts, _ = screen(lead, np.concatenate([axes, even]), freedom=freedom)
    num_tried = max(_LEAST_TRIED, round(_TRIED * num))
    tried = distinct(screened, _SAME_RAD, num_tried)
    starts = np.concatenate([axes, screened[tried]])
    shifts = np.concatenate([np.zeros(axes.shape[:2]), shifts[tried]])
    origins = np.repeat(["axes", "search"], [len(axes), len(tried)])
    if lead is not problem:
        maps = MatchingCosts(lead).assign(starts, np.ones(len(starts)), shifts)
        starts, _, shifts = similarities(problem, maps, freedom)
    trials = minimise(problem, starts, max_iterations=_TRIAL_STEPS, freedom=freedom, shifts=shifts, origins=origins)
    num_kept = max(_LEAST_KEPT, round(_KEPT * num_tried))
    kept = distinct(trials.rotations[:, : lead.dim, : lead.dim], _SAME_RAD, num_kept)
    return minimise(
        problem, trials.rotations[kept], freedom=freedom, shifts=trials.shifts[kept], origins=trials.origins[kept]
    )


def _screen_shifted(
    problem: Problem, rotations: FloatArray, freedom: Freedom
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Screen every rotation at no shift, and at shifts by one standard deviation along the target's axes."""
    weights = np.ones(problem.num_target)
    axes = principal_frame(problem.target, weights).T
    spread = np.sqrt((problem.target @ axes.T).var(axis=0))[:, None]
    offsets = np.concatenate([np.zeros((1, problem.dim)), spread * axes, -spread * axes])
    return screen(
        problem,
        np.repeat(rotations, len(offsets), axis=0),
        num_steps=_SHIFTED_STEPS,
        freedom=freedom,
        shifts=np.tile(offsets, (len(rotations), 1)),
    )


def look_around(
    problem: Problem,
    minima: LocalMinima,
    least_energy: float,
    *,
    seed: int = 0,
    freedom: Freedom = RIGID,
) -> LocalMinima:
    """Return the minima and those found by turning the best distinct ones a little: many basins are small.

    Parameters
    ----------
    problem : Problem
    minima : LocalMinima
        Best first.
    least_energy : float
        The least energy known, of either chirality; only minima not far above it are worth the look.
    seed, freedom
        As in :func:`search`.
    """
    block = rotation_block(problem.pattern)
    centres = distinct(minima.rotations[:, :block, :block], _ANGLE_AROUND_RAD / 2.0, _NUM_CENTRES)
    centres = centres[minima.energies[centres] <= _CENTRE_FACTOR * least_energy]
    turns = np.tile(np.eye(problem.dim), (_NUM_AROUND, 1, 1))
    turns[:, :block, :block] = small_rotations(block, _NUM_AROUND, _ANGLE_AROUND_RAD, seed=seed)
    starts = (turns @ minima.rotations[centres, None]).reshape(-1, problem.dim, problem.dim)
    shifts = np.repeat(minima.shifts[centres], _NUM_AROUND, axis=0)
    return merge([minima, minimise(problem, starts, freedom=freedom, shifts=shifts, origins="around")])


def distinct(rotations: FloatArray, angle_rad: float, num: int) -> IntArray:
    """Return positions of the first ``num`` rotations that are pairwise at least ``angle_rad`` apart, in order."""
    flat = rotations.reshape(len(rotations), -1)
    free = np.ones(len(rotations), dtype=bool)
    kept: list[int] = []
    traces = rotations.shape[-1] - 2.0 * (1.0 - np.cos(angle_rad))
    for position in range(len(rotations)):
        if len(kept) == num:
            break
        if free[position]:
            kept.append(position)
            free &= flat @ flat[position] <= traces
    return np.array(kept, dtype=np.int64)
