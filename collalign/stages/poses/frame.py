"""The common frame: a solution rotated as a whole, the gauge of the principal axes, and the origin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from collalign.options import AlignOptions
from collalign.products.shapes import Constraints
from collalign.synchronization import SynchronizationResult, principal_axes_gauge
from data_tools.arrays import FloatArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.poses import moved_by


def fix_frame(
    options: AlignOptions,
    samples: Sequence[Samples],
    rotations: FloatArray,
    solution: SynchronizationResult,
    constraints: Constraints,
) -> tuple[FloatArray, SynchronizationResult]:
    """Return poses and solution in the gauge that ``options.gauge`` asks for; fixed poses go before.

    They come in the gauge of the reference, which landmarks of it may rotate; "axes" is that of the principal axes of
    all posed samples together.

    Parameters
    ----------
    options : AlignOptions
    samples : sequence of Samples
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    solution : SynchronizationResult
        In the same frame.
    constraints : Constraints
    """
    if constraints.fixed or (options.gauge != "axes" and constraints.rotation is None):
        return rotations, solution
    if constraints.rotation is not None:
        posed = constraints.rotation @ rotations[constraints.reference].T @ rotations
    else:
        posed = principal_axes_gauge([item.positions for item in samples], rotations)
    rotation = posed[0] @ rotations[0].T
    return posed, rotated_solution(solution, np.tile(rotation, (len(samples), 1, 1)))


def with_origin(transforms: FloatArray, constraints: Constraints) -> FloatArray:
    """Return transforms (N, 4, 4) with the origin at the point of the reference that was asked for, if any was."""
    if constraints.origin is None or constraints.fixed_transforms:
        return transforms
    moved = transforms.copy()
    moved[:, :3, 3] -= moved_by(transforms[constraints.reference], constraints.origin)
    return moved


def rotated_solution(
    solution: SynchronizationResult, rotations: FloatArray
) -> SynchronizationResult:
    """Return the solution with the pose of each shape, and its alternatives, rotated in the common frame.

    Parameters
    ----------
    solution : SynchronizationResult
        Of rotations of space.
    rotations : ndarray, shape (N, 3, 3)
        The same for all shapes of a connected part.
    """
    alternatives = tuple(
        tuple(replace(pose, rotation=read_only(rotation @ pose.rotation)) for pose in poses)
        for rotation, poses in zip(rotations, solution.alternatives, strict=True)
    )
    return replace(
        solution, rotations=read_only(rotations @ solution.rotations), alternatives=alternatives
    )
