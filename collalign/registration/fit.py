"""A surface laid onto another in detail: where a map takes it, and from there by closest points with normals."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from collalign.registration.arap import ArapSolver, MapGoals
from collalign.registration.start import laid_by_map
from collalign.registration.tuning import BENT, TUNED
from data_tools.arrays import FloatArray
from data_tools.surface.normals import vertex_normals
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Correspondences beyond the cutoff, or so many radii where that is more, do not count, nor do those whose normals
#: differ by more than the cosine says.
_LEAST_DISTANCE, _MIN_COSINE = 0.01, 0.5
#: Times that closest points are asked, and for each that places and rotations are found in turn.
_NUM_ROUNDS, _NUM_TURNS = 6, 2


@one_blas_thread()
def fitted_by_map(target: Shape, source: Shape, goals: MapGoals) -> FloatArray:
    """Return the vertices of a source on a target where a map takes them, shape (v, 3), in whatever poses both are.

    The map's goals are smoothed as in :func:`collalign.registration.start.bent_by_map`, but over a shorter length;
    then closest points in positions and normals, both ways, take the place of the goals, and pieces of what the map
    gave stay rigid: pieces of the source would drag a surface that is stretched, as teddies are, along the target.

    Parameters
    ----------
    target, source : Shape
        Meshes, both outwards.
    goals : MapGoals
    """
    size = math.sqrt(target.area / source.area)
    enlarged = Shape.from_arrays(size * source.vertices, source.faces, name=source.name)
    moved = laid_by_map(ArapSolver(enlarged), goals, BENT.map_length)
    solver = ArapSolver(Shape.from_arrays(moved, source.faces, name=source.name))
    fixed = vertex_normals(target.vertices, target.faces)
    for _ in range(_NUM_ROUNDS):
        normals = vertex_normals(moved, source.faces)
        pulls, trust = _closest_points(target.vertices, fixed, moved, normals, solver.radius)
        pull = solver.pull(pulls, trust, BENT.point_length * solver.radius)
        for _ in range(_NUM_TURNS):
            moved = pull(solver.rotated_edges(moved))
    return moved


def _closest_points(
    places: FloatArray, fixed: FloatArray, moved: FloatArray, normals: FloatArray, radius: float
) -> tuple[MapGoals, FloatArray]:
    """Return the target's points that are closest to moved ones and to which those are, and the trust in each."""
    weight = BENT.normal_weight * radius
    theirs, ours = np.hstack([places, weight * fixed]), np.hstack([moved, weight * normals])
    at = np.concatenate([np.arange(len(ours)), cKDTree(ours).query(theirs)[1]])
    to = np.concatenate([cKDTree(theirs).query(ours)[1], np.arange(len(theirs))])
    distances = np.linalg.norm(places[to] - moved[at], axis=1)
    scale = TUNED.cutoff * max(float(np.median(distances)), _LEAST_DISTANCE * radius)
    trust = np.clip(1.0 - (distances / scale) ** 2, 0.0, 1.0) ** 2
    trust *= (fixed[to] * normals[at]).sum(axis=1) > _MIN_COSINE
    return (at, places[to]), trust
