"""Checks proofs by quasi-bounds without the search: do the cells tile all rotations, and what does each one prove.

SO(3) is four gnomonic charts of the unit quaternions, each a cube in u with ``x = tan(pi u / 4)``, halved along one
axis after the other; SO(2) is one interval of angles. The cells are known by their depths, in the order of their
faces and paths, because they tile. For any matrix L (a *tilt*, zero in the proof of a pair alone) the least of
F(R) - <L, R> is attained at a rotation R that is best for its own map under that energy. Where R lies in a cell,
beyond its rotation R0 by the angle theta about the axis a of the source's frame, it is at least

    F(R0) - <L, R0> - 4 |v x P| |v x R0^T Q|,       v = sin(theta / 2) a,

the norms being those of all points of weighted source and target, to both of which L adds some. F is the least
assignment, which is solved here again. The least of all cells is the bound, or what <L, R> is at most where no match
has a negative cost; every sum is lowered by what rounding can have added.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import scipy

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from pairwise.certificates.certificate import CertificateArrays
from pairwise.problem import Problem

_EPS = float(np.finfo(np.float64).eps)
#: Rounding allowances are multiples of eps, the number of terms and their sizes.
_SAFETY = 64.0
#: Added to every |v|: rounding of centres and corners.
REACH_MARGIN = 1e-7
#: Deepest cells, which are not split: their paths are numbers of 63 bits, their rotations differ by 1e-6 rad.
DEEPEST = 60
#: Numbers held at once.
_CHUNK_NUMBERS = 1_000_000


def cells_bound(problem: Problem, given: CertificateArrays) -> float:
    """Return the lower bound that a certificate of kind "cells" proves.

    Parameters
    ----------
    problem : Problem
        Over SO(d) or O(d), d = 2 or 3, full R; coordinates are at most 1.
    given : CertificateArrays
        ``proper_depths`` and, over O(d), ``reflected_depths``, integers.

    Raises
    ------
    InputError
        If the problem is another one, or an array is malformed.
    """
    names = ("proper", "reflected")[: num_chiralities(problem)]
    depths = [given.indices(f"{name}_depths", (None,), upper=DEEPEST + 1) for name in names]
    return tilted_bound(problem, np.zeros((problem.dim, problem.dim)), depths)


def num_chiralities(problem: Problem) -> int:
    """Return 1 for a problem over SO(d) and 2 over O(d).

    Raises
    ------
    InputError
        If d is neither 2 nor 3, or R is not full.
    """
    pattern, dim = problem.pattern, problem.dim
    if (
        dim not in (2, 3)
        or not pattern.mask.all()
        or pattern.special_blocks not in ((), ((0, dim),))
    ):
        raise InputError("certificate: this kind is for full rotations in dimension 2 and 3")
    return 1 if pattern.special_blocks else 2


def tilted_bound(problem: Problem, tilt: FloatArray, depths: Sequence[IntArray]) -> float:
    """Verify a bound by cells: return a lower bound of F(R) - <tilt, R> over the problem's group.

    Parameters
    ----------
    problem : Problem
    tilt : ndarray, shape (d, d)
    depths : sequence of ndarray of int
        Of the cells of rotations and, over O(d), of reflections.

    Raises
    ------
    InputError
        If the problem is another one, or these are not depths of cells that tile the rotations.
    """
    if len(depths) != num_chiralities(problem):
        raise InputError(
            f"depths: cells of {len(depths)} chiralities, expected {num_chiralities(problem)}"
        )
    signs = np.ones(problem.dim), np.array([-1.0, -1.0, -1.0] if problem.dim == 3 else [1.0, -1.0])
    bound = min(_chirality_bound(problem, tilt, *one) for one in zip(depths, signs, strict=False))
    if (problem.constant_cost < 0).any():
        return bound
    return max(bound, -float(np.linalg.norm(tilt, "nuc")) * (1.0 + _SAFETY * _EPS))


def _chirality_bound(
    problem: Problem, tilt: FloatArray, depths: IntArray, signs: FloatArray
) -> float:
    rotations, corners = cell_corners(*_tiling(depths, 4 if problem.dim == 3 else 1), problem.dim)
    w, p, q = problem.weights, problem.source, problem.target
    squares = w * ((q**2).sum(axis=1)[:, None] + (p**2).sum(axis=1))
    fixed = squares + problem.constant_cost
    values, chunk = np.empty(len(rotations)), max(1, _CHUNK_NUMBERS // fixed.size)
    for first in range(0, len(rotations), chunk):
        rotated = rotations[first : first + chunk] * signs
        costs = np.where(problem.allowed, fixed - 2.0 * (q @ rotated @ (w[:, None] * p).T), np.inf)
        assigned = [cost[scipy.optimize.linear_sum_assignment(cost)].sum() for cost in costs]
        values[first : first + chunk] = np.array(assigned) - (rotated * tilt).sum(axis=(1, 2))
    sizes = (squares + np.abs(problem.constant_cost)).sum(axis=0).max() * (
        len(p) + len(q)
    ) + np.abs(tilt).sum()
    return float(
        (values - _drops(problem, tilt, rotations, corners, signs)).min() - _SAFETY * _EPS * sizes
    )


def _tiling(depths: IntArray, num_faces: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return faces, depths and paths of the cells that come in this order and tile so many faces."""
    depths = np.asarray(depths, dtype=np.int64)
    if len(depths) and (depths.min() < 0 or depths.max() > DEEPEST):
        raise InputError("depths: outside what cells can have")
    faces, paths, start, end = np.zeros_like(depths), np.zeros_like(depths), 0, 1 << DEEPEST
    for at, depth in enumerate(depths.tolist()):
        face, within = divmod(start, end)
        if face >= num_faces or within % (1 << (DEEPEST - depth)):
            raise InputError("depths: the cells do not tile all rotations")
        faces[at], paths[at] = face, within >> (DEEPEST - depth)
        start += 1 << (DEEPEST - depth)
    if start != num_faces * end:
        raise InputError("depths: the cells do not tile all rotations")
    return faces, depths, paths


def _drops(
    problem: Problem,
    tilt: FloatArray,
    rotations: FloatArray,
    corners: FloatArray,
    signs: FloatArray,
) -> FloatArray:
    """Return what 4 |v x P| |v x R0^T Q| is at most in each cell.

    It is at most ``v^T B v`` with B = 2 g (tr A - A) + 2 (tr A' - R0^T A' R0) / g for any g, where A = P^T P and
    A' = Q^T Q. Where that is at most the least eigenvalue of B at all corners, the unit quaternions (w, v) of that
    value or less make a convex cone, so that it is no larger inside; else |v|^2 is at most that of a corner.
    tilt / 2 = sum s u v^T adds f sqrt(s) v to the source and sqrt(s) u / f to the target, for any f.
    """
    left, strengths, right = np.linalg.svd(0.5 * tilt)
    first, second = problem.weights[:, None] * problem.source, problem.target
    sizes = [float((points**2).sum()) for points in (first, second)]
    factor = np.sqrt(sizes[0] / sizes[1]) if min(sizes) > 0.0 else 1.0
    of_source = (first.T @ first + factor * (right.T * strengths) @ right) * signs * signs[:, None]
    of_target = second.T @ second + (left * strengths) @ left.T / factor
    traces = np.array([np.trace(of_source), np.trace(of_target)])
    balance = np.sqrt(traces[1] / traces[0]) if traces.min() > 0.0 else 1.0
    shares, dim = 2.0 * np.array([balance, 1.0 / balance]), problem.dim
    forms = np.tile((shares @ traces) * np.eye(3), (len(rotations), 1, 1))
    rotated = np.swapaxes(rotations, 1, 2) @ of_target @ rotations
    forms[:, :dim, :dim] -= shares[0] * of_source + shares[1] * rotated
    values = np.einsum("mca,mab,mcb->mc", corners, forms, corners).max(axis=1)
    spectrum = np.linalg.eigvalsh(forms)
    largest = spectrum[:, -1] * (corners**2).sum(axis=2).max(axis=1)
    drops = np.sqrt(np.where(values <= spectrum[:, 0], values, largest)) + REACH_MARGIN * np.sqrt(
        spectrum[:, -1]
    )
    return np.asarray(drops**2 * (1.0 + _SAFETY * _EPS * (len(first) + len(second))))


def cell_corners(
    faces: IntArray, depths: IntArray, paths: IntArray, dim: int
) -> tuple[FloatArray, FloatArray]:
    """Return the rotations at the centres of cells (m, d, d), and v of all their corners (m, c, 3)."""
    axes = 3 if dim == 3 else 1
    low, side = -np.ones((len(faces), axes)), np.full((len(faces), axes), 2.0)
    for level in range(int(depths.max(initial=0))):
        is_split, axis = level < depths, level % axes
        upper = (paths >> np.maximum(depths - 1 - level, 0)) & 1
        side[is_split, axis] *= 0.5
        low[is_split, axis] += (upper * side[:, axis])[is_split]
    if dim == 2:
        angles = np.pi * (low[:, 0] + 0.5 * side[:, 0])
        rotations = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]])
        return rotations.transpose(2, 0, 1), np.sin(0.25 * np.pi * side[:, :, None]) * np.array(
            [0.0, 0.0, 1.0]
        )
    middle = _quaternions(faces, low + 0.5 * side)
    corners = []
    for corner in product((0.0, 1.0), repeat=3):
        far = _quaternions(faces, low + np.array(corner) * side)
        corners.append(
            middle[:, :1] * far[:, 1:]
            - far[:, :1] * middle[:, 1:]
            - np.cross(middle[:, 1:], far[:, 1:])
        )
    return _rotations(middle), np.stack(corners, axis=1)


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
    return np.asarray(
        diagonal + 2.0 * v[:, :, None] * v[:, None, :] + 2.0 * w[:, None, None] * cross
    )
