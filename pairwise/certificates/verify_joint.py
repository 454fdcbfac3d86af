"""Checks lower bounds of the energy of all arrangements of a collection, without the search that found them.

For one pose R_i per shape the energy is the sum over pairs of F_ij(R_i^T R_j). For any matrices L_ij (*tilts*) and
any symmetric Y_i, with S the matrix that has L_ij / 2 beside the diagonal and Y_i on it,

    sum_ij F_ij(R_i^T R_j)  =  sum_ij [F_ij - <L_ij, .>](R_i^T R_j)  +  tr X^T S X  -  tr Y,    X the stack of R_i^T,

because X_i X_j^T = R_i^T R_j. The first terms are at least their minima over all rotations, and tr X^T S X is at
least dN min(0, least eigenvalue of S). A minimum of F - <L, .> is bounded cell by cell as that of F is
(:mod:`pairwise.certificates.verify_cells`): where it is attained, with map m, R is best for M_m + L / 2, so that
F - <L, .> falls within a cell of radius r by at most 2 (1 - cos r) K. The cells are known by their depths, in the
order of their paths, because they tile; the assignments are solved again. Whatever the numbers are, what is
returned holds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread
from pairwise.certificates.verify_cells import DEEPEST, cell_balls
from pairwise.problem.problem import Problem

_EPS = float(np.finfo(np.float64).eps)
#: Rounding allowances are multiples of eps, the number of terms and their sizes.
_SAFETY = 64.0
#: Cells whose costs are held at once.
_CHUNK = 256


@one_blas_thread()
def tilted_bound(problem: Problem, tilt: FloatArray, depths: Sequence[IntArray]) -> float:
    """Return a lower bound of F(R) - <tilt, R> over SO(3) or O(3).

    Parameters
    ----------
    problem : Problem
        In space.
    tilt : ndarray, shape (3, 3)
    depths : sequence of ndarray of int
        Of the cells of rotations and, over O(3), of reflections, see
        :class:`pairwise.branch_and_bound.tilted.TiltedProof`.

    Raises
    ------
    InputError
        If the problem is another one, or these are not depths of cells that tile the rotations.
    """
    if problem.dim != 3:
        raise InputError("a joint bound is for points in space")
    signs = (1.0,) if problem.pattern.special_blocks else (1.0, -1.0)
    if len(depths) != len(signs):
        raise InputError(f"depths: cells of {len(depths)} chiralities, expected {len(signs)}")
    loss = _curvature(problem, tilt)
    return min(_chirality_bound(problem, tilt, some, sign, loss) for some, sign in zip(depths, signs, strict=True))


def _chirality_bound(problem: Problem, tilt: FloatArray, depths: IntArray, sign: float, curvature: float) -> float:
    rotations, radii = cell_balls(*_tiling(depths), 3)
    w, p, q = problem.weights, problem.source, problem.target
    fixed = w * ((q**2).sum(axis=1)[:, None] + (p**2).sum(axis=1)) + problem.constant_cost
    values = np.empty(len(radii))
    for first in range(0, len(radii), _CHUNK):
        turned = sign * rotations[first : first + _CHUNK]
        costs = np.where(problem.allowed, fixed - 2.0 * (q @ turned @ (w[:, None] * p).T), np.inf)
        values[first : first + _CHUNK] = [_assigned(cost.T) for cost in costs] - (turned * tilt).sum(axis=(1, 2))
    sizes = np.abs(fixed).sum(axis=0).max() * (len(p) + len(q)) + np.abs(tilt).sum()
    drop = 4.0 * np.sin(0.5 * radii) ** 2 * curvature * (1.0 + _SAFETY * _EPS)
    return float((values - drop).min() - _SAFETY * _EPS * sizes)


def _tiling(depths: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return faces, depths and paths of the cells of four faces that come in this order and tile them."""
    depths = np.asarray(depths, dtype=np.int64)
    if len(depths) and (depths.min() < 0 or depths.max() > DEEPEST):
        raise InputError("depths: outside what cells can have")
    faces, paths, start, end = np.zeros_like(depths), np.zeros_like(depths), 0, 1 << DEEPEST
    for at, depth in enumerate(depths.tolist()):
        face, within = divmod(start, end)
        if face > 3 or within % (1 << (DEEPEST - depth)):
            raise InputError("depths: the cells do not tile all rotations")
        faces[at], paths[at] = face, within >> (DEEPEST - depth)
        start += 1 << (DEEPEST - depth)
    if start != 4 * end:
        raise InputError("depths: the cells do not tile all rotations")
    return faces, depths, paths


def _curvature(problem: Problem, tilt: FloatArray) -> float:
    """Return K = s1 s1' + s2 s2' of both point sets; tilt / 2 = sum s u v^T adds g sqrt(s) v and sqrt(s) u / g."""
    left, strengths, right = np.linalg.svd(0.5 * tilt)
    roots, source = np.sqrt(strengths)[:, None], problem.weights[:, None] * problem.source
    sizes = [float(np.linalg.norm(points)) for points in (source, problem.target)]
    factor = float(np.sqrt(sizes[0] / sizes[1])) if min(sizes) > 0.0 else 1.0
    first = np.linalg.svd(np.vstack([source, factor * roots * right]), compute_uv=False)[:2]
    second = np.linalg.svd(np.vstack([problem.target, roots * left.T / factor]), compute_uv=False)[:2]
    return float(first @ second) * (1.0 + _SAFETY * _EPS * (len(source) + len(problem.target)))


def _assigned(costs: FloatArray) -> float:
    rows, columns = linear_sum_assignment(costs)
    return float(costs[rows, columns].sum())


def gram_matrix(edges: IntArray, tilts: FloatArray, diagonal: FloatArray) -> FloatArray:
    """Return S, shape (3N, 3N), of tilts (E, 3, 3) of distinct pairs (E, 2) and blocks Y (N, 3, 3)."""
    num, (left, right) = len(diagonal), edges.T
    matrix, every = np.zeros((num, 3, num, 3)), np.arange(num)
    matrix[left, :, right] = 0.5 * tilts
    matrix[right, :, left] = 0.5 * np.swapaxes(tilts, 1, 2)
    matrix[every, :, every] = 0.5 * (diagonal + np.swapaxes(diagonal, 1, 2))
    return matrix.reshape(3 * num, 3 * num)


@one_blas_thread()
def gram_bound(edges: IntArray, tilts: FloatArray, diagonal: FloatArray) -> float:
    """Return what ``sum <L_ij, R_i^T R_j>`` is at least, for all poses of N shapes.

    Parameters
    ----------
    edges : ndarray of int, shape (E, 2)
    tilts : ndarray, shape (E, 3, 3)
    diagonal : ndarray, shape (N, 3, 3)
    """
    matrix = gram_matrix(edges, tilts, diagonal)
    least = float(np.linalg.eigvalsh(matrix)[0]) - _rounding(matrix)
    return len(matrix) * min(0.0, least) - float(np.trace(matrix)) - _rounding(matrix)


@one_blas_thread()
def largest_turns(
    edges: IntArray, tilts: FloatArray, diagonal: FloatArray, frames: FloatArray, gap: float
) -> FloatArray:
    """Bound the angles by which poses of a total energy at most that of the given ones can differ from these.

    With D the stack of R_i^T at i and -R_j^T at j, and W_i = (R_i^T)^T X_i what turns shape i, W_i - W_j = D^T X, so
    |W_i - W_j|^2 <= tr X^T S X times the largest eigenvalue of D^T S^-1 D where S is positive definite, and it is
    8 sin^2(angle / 2), and at least 4 where just one of them is mirrored.

    Parameters
    ----------
    edges, tilts, diagonal
        As for :func:`gram_bound`.
    frames : ndarray, shape (N, 3, 3)
        R_i.
    gap : float
        The energy of these poses less the sum of the pairs' bounds: then tr X^T S X - tr Y is at most that.

    Returns
    -------
    ndarray, shape (N,)
        For each shape the median over the others, in radians; pi where its pose, or its mirror image, is left free.
    """
    matrix, num = gram_matrix(edges, tilts, diagonal), len(frames)
    shift = max(0.0, _rounding(matrix) - float(np.linalg.eigvalsh(matrix)[0]))
    slack = gap + float(np.trace(matrix)) + _rounding(matrix)
    least = np.full((num, num), np.inf)
    for share in _SHIFTS:
        more = shift + share * max(slack, 0.0) / len(matrix)
        if more > 0.0:
            resistances = _resistances(matrix + more * np.eye(len(matrix)), frames)
            least = np.minimum(least, (slack + len(matrix) * more) * resistances)
    turns = np.where(least < 4.0, 2.0 * np.arcsin(np.sqrt(np.clip(least / 8.0, 0.0, 1.0))), np.pi)
    others = turns[~np.eye(num, dtype=bool)].reshape(num, num - 1)
    return np.asarray(np.median(others, axis=1))


#: By what share of the slack S is raised in all, to be inverted: the least result of these counts.
_SHIFTS = (0.01, 0.1, 1.0)


def _resistances(matrix: FloatArray, frames: FloatArray) -> FloatArray:
    """Return the largest eigenvalue of D^T S^-1 D for all pairs of shapes, (N, N)."""
    num = len(frames)
    blocks = np.linalg.inv(matrix).reshape(num, 3, num, 3)
    turned = np.einsum("iab,ibjc,jdc->ijad", frames, blocks, frames, optimize=True)
    own = turned[np.arange(num), np.arange(num)]
    both = own[:, None] + own[None] - turned - np.swapaxes(turned, 2, 3)
    return np.asarray(np.linalg.eigvalsh(both)[..., -1] * (1.0 + 1e-9))


def _rounding(matrix: FloatArray) -> float:
    """Return more than rounding can have changed an eigenvalue or the trace by."""
    return 8.0 * len(matrix) * _EPS * float(np.linalg.norm(matrix))
