"""Checks proofs by quasi-bounds without the search: do the cells tile all rotations, and what does each one prove.

A cell is named by its face and its path: SO(3) is four gnomonic charts of the unit quaternions, each a cube in u with
``x = tan(pi u / 4)``, halved along one axis after the other; SO(2) is one interval of angles. Every pose (R*, map)
whose R* is best for its own map and lies within the angle r of the cell's rotation R0 has at least the energy

    sum_j min_i (c_ji(R0) - v_i) + (N - k) min_i (-v_i) + sum_i v_i - 2 (1 - cos r) K

for any potentials v of the N columns (targets, and one per source point that may stay unmatched), K = s1 s1' + s2 s2'
of the singular values of weighted source and target; in partial matching K is 0 and each cost is lowered by
2 (1 - cos r) w_j |p_j| |q_i| instead. The optimum is such a pose, so the least of all cells bounds the energy. Every
sum is lowered by what rounding can have added (all coordinates are at most 1 here).
"""

from __future__ import annotations

from itertools import product

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from pairwise.certificates.arrays import CertificateArrays
from pairwise.problem.problem import Problem

_EPS = float(np.finfo(np.float64).eps)
#: Rounding allowances are multiples of eps, the number of terms and their sizes.
_SAFETY = 64.0
#: Added to every radius, in radians: rounding of centres, corners and arc sines.
_RADIUS_MARGIN = 1e-7
#: Deepest cells: their paths are numbers of 63 bits.
DEEPEST = 60
#: Numbers held at once.
_CHUNK_NUMBERS = 2_000_000


def cells_bound(problem: Problem, given: CertificateArrays) -> float:
    """Return the lower bound that a certificate of kind "cells" proves.

    Parameters
    ----------
    problem : Problem
        Over SO(d) or O(d), d = 2 or 3, full R; coordinates are at most 1.
    given : CertificateArrays
        For each chirality ``NAME`` in ``proper`` and, over O(d), ``reflected``: ``NAME_faces``, ``NAME_depths``,
        ``NAME_paths`` and ``NAME_evidence`` (m,), integers, and ``NAME_potentials`` (t, N).

    Raises
    ------
    InputError
        If an array is malformed or the cells do not tile the rotations.
    """
    pattern, dim = problem.pattern, problem.dim
    if dim not in (2, 3) or not pattern.mask.all() or pattern.special_blocks not in ((), ((0, dim),)):
        raise InputError("certificate: this kind is for full rotations in dimension 2 and 3")
    bound = _chirality_bound(problem, problem.source, given, "proper")
    if not pattern.special_blocks:
        flipped = -problem.source if dim == 3 else problem.source * np.array([1.0, -1.0])
        bound = min(bound, _chirality_bound(problem, flipped, given, "reflected"))
    return max(bound, 0.0) if (problem.constant_cost >= 0).all() else bound


def _chirality_bound(problem: Problem, source: FloatArray, given: CertificateArrays, name: str) -> float:
    faces = given.indices(f"{name}_faces", (None,), upper=4 if problem.dim == 3 else 1)
    depths = given.indices(f"{name}_depths", faces.shape, upper=DEEPEST + 1)
    paths = given.indices(f"{name}_paths", faces.shape, upper=2**DEEPEST)
    columns = problem.num_target
    potentials = given.floats(f"{name}_potentials", (None, columns))
    evidence = given.indices(f"{name}_evidence", faces.shape, upper=len(potentials))
    _check_tiling(faces, depths, paths, 4 if problem.dim == 3 else 1)
    rotations, radii = cell_balls(faces, depths, paths, problem.dim)
    chunk = max(1, _CHUNK_NUMBERS // (problem.num_source * columns))
    parts = [slice(first, first + chunk) for first in range(0, len(faces), chunk)]
    return min(float(_bounds(problem, source, rotations[p], radii[p], potentials[evidence[p]]).min()) for p in parts)


def _check_tiling(faces: IntArray, depths: IntArray, paths: IntArray, num_faces: int) -> None:
    """Refuse cells that leave out or repeat a rotation: of each face their intervals of paths must tile [0, 1)."""
    starts: list[list[tuple[int, int]]] = [[] for _ in range(num_faces)]
    for face, depth, path in zip(faces.tolist(), depths.tolist(), paths.tolist(), strict=True):
        if path >> depth:
            raise InputError("certificate: a path is longer than its cell is deep")
        starts[face].append((path << (DEEPEST - depth), 1 << (DEEPEST - depth)))
    for intervals in starts:
        end = 0
        for start, length in sorted(intervals):
            if start != end:
                raise InputError("certificate: the cells do not tile all rotations")
            end = start + length
        if end != 1 << DEEPEST:
            raise InputError("certificate: the cells do not tile all rotations")


def cell_balls(faces: IntArray, depths: IntArray, paths: IntArray, dim: int) -> tuple[FloatArray, FloatArray]:
    """Return the rotations at the centres of cells (m, d, d) and how far their farthest ones are, in radians (m,)."""
    axes = 3 if dim == 3 else 1
    low, side = -np.ones((len(faces), axes)), np.full((len(faces), axes), 2.0)
    for level in range(int(depths.max(initial=0))):
        is_split, axis = level < depths, level % axes
        upper = (paths >> np.maximum(depths - 1 - level, 0)) & 1
        side[is_split, axis] *= 0.5
        low[is_split, axis] += (upper * side[:, axis])[is_split]
    if dim == 2:
        angles = np.pi * (low[:, 0] + 0.5 * side[:, 0])
        turns = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]])
        return turns.transpose(2, 0, 1), np.minimum(0.5 * np.pi * side[:, 0] + _RADIUS_MARGIN, np.pi)
    middle = _quaternions(faces, low + 0.5 * side)
    radii = np.zeros(len(faces))
    for corner in product((0.0, 1.0), repeat=3):
        chord = np.sqrt(((_quaternions(faces, low + np.array(corner) * side) - middle) ** 2).sum(axis=1))
        radii = np.maximum(radii, 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))
    return _rotations(middle), np.minimum(radii + _RADIUS_MARGIN, np.pi)


def _quaternions(faces: IntArray, u: FloatArray) -> FloatArray:
    """Return unit quaternions (m, 4): 1 at the face's place, tan(pi u / 4) at the others in order, normalised."""
    x = np.tan(0.25 * np.pi * u)
    by_face = [np.insert(x, face, 1.0, axis=1) for face in range(4)]
    chosen = np.choose(faces[:, None], by_face)
    return np.asarray(chosen / np.sqrt((chosen**2).sum(axis=1, keepdims=True)))


def _rotations(q: FloatArray) -> FloatArray:
    """Return ``(w^2 - |v|^2) I + 2 v v^T + 2 w [v]`` for unit quaternions (w, v), shape (m, 3, 3)."""
    w, v = q[:, 0], q[:, 1:]
    cross = np.zeros((len(q), 3, 3))
    cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0] = v.T
    cross -= np.swapaxes(cross, 1, 2)
    diagonal = (w**2 - (v**2).sum(axis=1))[:, None, None] * np.eye(3)
    return np.asarray(diagonal + 2.0 * v[:, :, None] * v[:, None, :] + 2.0 * w[:, None, None] * cross)


def _bounds(problem: Problem, p: FloatArray, rotations: FloatArray, radii: FloatArray, v: FloatArray) -> FloatArray:
    """Return what every cell proves, shape (m,)."""
    q, w = problem.target, problem.weights
    loss = 4.0 * np.sin(0.5 * radii) ** 2 * (1.0 + _SAFETY * _EPS)
    fixed = w * ((q**2).sum(axis=1)[:, None] + (p**2).sum(axis=1)) + problem.constant_cost
    costs = np.where(problem.allowed, fixed - 2.0 * w * (q @ rotations @ p.T), np.inf)
    least = (costs - v[:, :, None]).min(axis=1)
    num_zero = v.shape[1] - len(p)
    floor = -v.max(axis=1) * num_zero
    value = least.sum(axis=1) + floor + v.sum(axis=1)
    sizes = np.abs(least).sum(axis=1) + np.abs(floor) + np.abs(v).sum(axis=1)
    sizes += len(p) * np.abs(v).max(axis=1) + (np.abs(fixed) + 8.0 * w).max(axis=0).sum()
    value -= _SAFETY * _EPS * (v.shape[1] + len(p) + 8) * sizes
    return value - loss * _curvature(problem, p)


def _curvature(problem: Problem, p: FloatArray) -> float:
    """Return K, raised by the backward error of the singular values."""
    source, target = problem.weights[:, None] * p, problem.target
    first, second = (np.linalg.svd(points, compute_uv=False)[:2] for points in (source, target))
    num = min(len(first), len(second))
    size = float(np.linalg.norm(source) * np.linalg.norm(target))
    return float(first[:num] @ second[:num]) + _SAFETY * _EPS * (len(p) + len(target)) * size
