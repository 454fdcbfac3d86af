"""Slow, independent answers for small problems: what the fast code is compared with.

Nothing here calls the numerical code under test: rotations, maps and lifted constraints are recomputed from their
definitions. ``tests/test_oracles.py`` shows that each oracle rejects a wrong answer.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Optimum:
    """The global optimum of a small problem, by trying every injective map."""

    energy: float
    rotation: NDArray[np.float64]
    point_map: NDArray[np.int64]


def injective_maps(allowed):
    """Every injective map inside the allowed matches (n, k), shape (num, k)."""
    n, k = allowed.shape
    maps = np.array(list(itertools.permutations(range(n), k)), dtype=np.int64)
    return maps[allowed[maps, np.arange(k)].all(axis=1)]


def brute_force(problem):
    """The global optimum over all maps; R in closed form for each. For patterns made of blocks, n <= 7."""
    energies, rotations, maps = every_pose(problem)
    best = int(np.argmin(energies))
    return Optimum(float(energies[best]), rotations[best], maps[best])


def every_pose(problem):
    """The best pose of every map: energies, rotations and maps."""
    source, weights = problem.source, problem.weights
    maps = injective_maps(problem.allowed)
    images = problem.target[maps]
    correlations = np.einsum("mka,k,kb->mab", images, weights, source)
    rotations = np.zeros_like(correlations)
    for start, stop, special in _blocks(problem):
        part = slice(start, stop)
        rotations[:, part, part] = _best_rotations(correlations[:, part, part], special)
    residuals = np.einsum("mab,kb->mka", rotations, source) - images
    constants = problem.constant_cost[maps, np.arange(problem.num_source)].sum(axis=1)
    return (weights * (residuals**2).sum(axis=2)).sum(axis=1) + constants, rotations, maps


def check_pose(problem, rotation, point_map, energy, tol=1e-9):
    """What is wrong with a claimed pose; empty if nothing is."""
    wrong = []
    if np.abs(rotation @ rotation.T - np.eye(problem.dim)).max() > tol:
        wrong.append("R is not orthogonal")
    if np.abs(rotation[~problem.pattern.mask]).max(initial=0.0) > tol:
        wrong.append("R leaves its pattern")
    for start, stop in problem.pattern.special_blocks:
        if np.linalg.det(rotation[start:stop, start:stop]) < 0:
            wrong.append("a rotation block is a reflection")
    if len(set(point_map.tolist())) < len(point_map):
        wrong.append("the map is not injective")
    if not all(problem.allowed[i, j] for j, i in enumerate(point_map)):
        wrong.append("the map leaves the allowed matches")
    own = 0.0
    for j, i in enumerate(point_map):
        gap = rotation @ problem.source[j] - problem.target[i]
        own += problem.weights[j] * float(gap @ gap) + problem.constant_cost[i, j]
    if abs(own - energy) > tol * (1.0 + abs(own)):
        wrong.append(f"the energy is {own}, not {energy}")
    return wrong


def check_relaxation(problem, result, tol, *, row_sums=False):
    """Which constraints of PM-SDP, with the leading row kept, a claimed solution violates; empty if none.

    With ``row_sums`` also those that a problem of as many target as source points has beside the published ones.
    """
    wrong = []
    x, b, c = result.X, result.B, result.C
    entries = problem.pattern.pack(result.R)
    if x.min() < -tol or np.abs(x.sum(axis=0) - 1).max() > tol or x.sum(axis=1).max() > 1 + tol:
        wrong.append("X is not doubly (sub)stochastic")
    if x[~problem.allowed].max(initial=0.0) > tol:
        wrong.append("X leaves the allowed matches")
    for j in range(problem.num_source):
        head = np.concatenate([[1.0], x[:, j], entries])[None, :]
        body = np.block([[x[:, [j]], np.diag(x[:, j]), b[j].T], [entries[:, None], b[j], c]])
        if np.linalg.eigvalsh(np.vstack([head, body]))[0] < -tol:
            wrong.append(f"the lifted matrix of source point {j} is not PSD")
    if row_sums and np.abs(b.sum(axis=0) - entries[:, None]).max() > tol:
        wrong.append("the shares of R of a target point do not add up to R")
    if _orthogonality_gap(problem, c) > tol:
        wrong.append("C does not satisfy R R^T = R^T R = I")
    for start, stop in problem.pattern.special_blocks:
        if stop - start in (2, 3) and not in_rotation_hull(result.R[start:stop, start:stop], tol):
            wrong.append("R is outside the convex hull of the rotations")
    if abs(relaxed_energy(problem, x, b) - result.value) > tol * (1 + abs(result.value)):
        wrong.append("the value is not the relaxed energy")
    return wrong


def relaxed_energy(problem, x, b):
    """The energy as a linear function of X (n, k) and B (k, r, n), by loops over the matches."""
    total = 0.0
    for j, p in enumerate(problem.source):
        for i, q in enumerate(problem.target):
            conditional = problem.pattern.unpack(b[j, :, i])
            squares = x[i, j] * float(q @ q + p @ p)
            total += problem.weights[j] * (squares - 2.0 * float(q @ conditional @ p))
            total += problem.constant_cost[i, j] * x[i, j]
    return total


def in_rotation_hull(matrix, tol):
    """Whether a 2 x 2 or 3 x 3 matrix is in conv SO, by its singular values.

    With the last singular value signed by the determinant, conv SO(3) is where ``1 + s1 + s2 + s3``,
    ``1 + s1 - s2 - s3``, ``1 - s1 + s2 - s3`` and ``1 - s1 - s2 + s3`` are non-negative (Saunderson, Parrilo, Willsky
    2015); conv SO(2) holds the rotations scaled by at most one.
    """
    u, s, vt = np.linalg.svd(matrix)
    s[-1] *= np.sign(np.linalg.det(u @ vt))
    if len(matrix) == 2:
        return bool(abs(s[0] - s[1]) <= 2 * tol and s[0] <= 1 + tol)
    signs = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return bool((1.0 + signs @ s).min() >= -4 * tol)


def isometries(target, source, tol=1e-6):
    """Every map under which distances among the points and to the origin agree, by backtracking."""
    q, p = (np.vstack([np.zeros(points.shape[1]), points]) for points in (target, source))
    of_target, of_source = (np.linalg.norm(x[:, None] - x[None], axis=2) for x in (q, p))
    found = []

    def extend(images):
        point = len(images)
        if point == len(p):
            found.append(np.array(images[1:]) - 1)
            return
        for image in set(range(1, len(q))) - set(images):
            if np.abs(of_target[image, images] - of_source[point, :point]).max() <= tol:
                extend([*images, image])

    extend([0])
    return found


def _blocks(problem):
    """Contiguous diagonal blocks that fill the pattern, with whether each is a rotation block."""
    mask, blocks, start = problem.pattern.mask, [], 0
    while start < problem.dim:
        stop = start + int(mask[start, start:].sum())
        blocks.append((start, stop, (start, stop) in problem.pattern.special_blocks))
        start = stop
    filled = np.zeros_like(mask)
    for first, last, _ in blocks:
        filled[first:last, first:last] = True
    wholes = {(first, last) for first, last, _ in blocks}
    if not np.array_equal(filled, mask) or not wholes.issuperset(problem.pattern.special_blocks):
        raise ValueError(
            "brute force needs a pattern of diagonal blocks, rotation blocks among them"
        )
    return blocks


def _best_rotations(correlations, special):
    u, _, vt = np.linalg.svd(correlations)
    signs = np.ones(correlations.shape[:2])
    if special:
        signs[:, -1] = np.linalg.det(u) * np.linalg.det(vt)
    return (u * signs[:, None, :]) @ vt


def _orthogonality_gap(problem, c):
    """The largest violation of ``E[R R^T] = E[R^T R] = I`` at C, from its definition."""
    d = problem.dim
    rows, cols = problem.pattern.entries
    products = np.zeros((d, d, d, d))
    products[rows[:, None], cols[:, None], rows, cols] = c
    outer = np.einsum("asbs->ab", products) - np.eye(d)
    inner = np.einsum("sasb->ab", products) - np.eye(d)
    return float(max(np.abs(outer).max(), np.abs(inner).max()))
