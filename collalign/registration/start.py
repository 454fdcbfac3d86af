"""Where maps of vertices take a surface before closest points pull, and back: locally as rigid as they allow."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from collalign.registration.arap import ArapSolver, MapGoals
from collalign.registration.tuning import BENT, TUNED
from data_tools.arrays import FloatArray
from data_tools.poses import fitting_similarity, scales_of
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Times that the map is asked where it can be trusted, and for each that places and rotations are found in turn.
_NUM_TRUSTS, _NUM_ROUNDS = 3, 5


@one_blas_thread()
def bent_by_map(target: Shape, source: Shape, goals: MapGoals) -> FloatArray | None:
    """Return the vertices of a source where a map takes them, shape (v, 3), smoothed; None where it is not believed.

    Least is ``sum_ij w_ij |x_i - x_j - R_i (p_i - p_j)|^2 + sum_i m_i t_i |x_i - g_i|^2 / l^2`` over places ``x`` and
    rotations ``R`` of the source's vertices ``p``, enlarged to the target's area: cotangent weights ``w``, areas
    ``m``, goals ``g`` in which the map is trusted by ``t``, Tukey's biweight of their distance from ``x``. Limbs
    turn, and what a map scatters is smoothed over the length ``l``, without the shrinking of a plain average.

    Not believed are maps of less than half of the surface, those that have no order, and those that turn all of it
    against the common poses: a symmetric body has a second map, which is as smooth.

    Parameters
    ----------
    target, source : Shape
        Meshes, posed.
    goals : MapGoals

    References
    ----------
    Sorkine and Alexa, As-rigid-as-possible surface modeling, SGP 2007.
    """
    size = math.sqrt(target.area / source.area)
    rest = Shape.from_arrays(size * source.vertices, source.faces, name=source.name)
    solver = ArapSolver(rest)
    if solver.mass[np.unique(goals[0])].sum() < BENT.least_share * solver.mass.sum():
        return None
    moved = laid_by_map(solver, goals, BENT.length)
    fit = fitting_similarity(moved, rest.vertices, solver.mass)[:3, :3]
    is_small = scales_of(fit) < BENT.least_extent
    is_turned = rotation_angle_deg(nearest_orthogonal(fit), np.eye(3)) > BENT.most_turn_deg
    return None if is_small or is_turned else moved


def laid_by_map(solver: ArapSolver, goals: MapGoals, length: float) -> FloatArray:
    """Return the places of least energy of :func:`bent_by_map`, shape (v, 3), with ``l`` so many radii."""
    vertices, places = goals
    trust, edges = np.ones(len(vertices)), np.zeros((len(solver.mass), 3))
    for _ in range(_NUM_TRUSTS):
        pull = solver.pull(goals, trust, length * solver.radius)
        for _ in range(_NUM_ROUNDS):
            moved = pull(edges)
            edges = solver.rotated_edges(moved)
        distances = np.linalg.norm(moved[vertices] - places, axis=1)
        scale = TUNED.cutoff * float(np.median(distances)) or 1.0
        trust = np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2
    return moved


@one_blas_thread()
def unbent(source: Shape, copies: Sequence[FloatArray]) -> list[FloatArray]:
    """Return copies of a source that are bent in other ways in its own posture, each (v, 3).

    The edges of a copy are turned back as each vertex's edges are turned, and a surface is laid through them by least
    squares: it has the copy's local lengths and the source's posture. The plain mean of bodies in several postures
    has limbs that are thin where they differ; that of unbent ones has not.

    Parameters
    ----------
    source : Shape
        A mesh.
    copies : sequence of ndarray, shape (v, 3)
    """
    solver = ArapSolver(source)
    num = len(source.vertices)
    pull = solver.pull((np.arange(num), source.vertices), np.ones(num), BENT.loose * solver.radius)
    return [pull(solver.rotated_back(copy)) for copy in copies]
