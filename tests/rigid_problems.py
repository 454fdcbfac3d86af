"""Small random and degenerate problems over SO(2), SO(3), O(2), O(3), whose optimum brute force can find."""

import numpy as np

from pairwise.problem import Problem
from tests.problems import in_unit

#: How the points lie.
SHAPES = ("general", "coplanar", "collinear", "symmetric", "repeated", "one place", "noise-free")


def small_problem(seed, *, max_target=6):
    """A problem that depends on the seed alone: kind of points, group, sizes, allowed, weights, invariants."""
    rng = np.random.default_rng([seed, 1207])
    shape = SHAPES[seed % len(SHAPES)]
    dim = int(rng.choice([2, 3, 3]))
    n = int(rng.integers(2, max_target + 1))
    k = n if rng.random() < 0.5 else int(rng.integers(1, n + 1))
    target = _points(shape, n, dim, rng)
    rotation = np.linalg.qr(rng.standard_normal((dim, dim)))[0]
    noise = 0.0 if shape == "noise-free" else rng.choice([0.02, 0.1, 0.3])
    source = (target[rng.permutation(n)[:k]] + noise * rng.standard_normal((k, dim))) @ rotation
    optional = {"group": str(rng.choice(["SO", "O"]))}
    if rng.random() < 0.3:
        allowed = rng.random((n, k)) < 0.6
        allowed[rng.permutation(n)[:k], np.arange(k)] = True
        optional["allowed"] = allowed
    if rng.random() < 0.3:
        optional["weights"] = rng.choice([0.0, 0.5, 1.0, 2.0], size=k) + 0.1
    if rng.random() < 0.3:
        optional["invariants"] = (rng.standard_normal((n, 1)), rng.standard_normal((k, 1)))
    return Problem.from_user(target, source, **optional)


def rigid_problem(seed, *, max_target=6):
    """A small problem, at a scale of 1e-6 to 1e6."""
    problem = small_problem(seed, max_target=max_target)
    rng = np.random.default_rng([seed, 33])
    return in_unit(problem, 10.0 ** rng.uniform(-6, 6))


def is_pointed(problem):
    """Whether a map decides its rotation: not where in space all points of a shape are on one line."""
    ranks = [np.linalg.matrix_rank(points) for points in (problem.target, problem.source)]
    return problem.dim == 2 or min(*ranks, problem.num_source) > 1


def planted_cube(num, noise, seed, *, num_source=None):
    """Uniform points in the unit cube and (part of) their noisy, rotated, shuffled copy, both centred when whole."""
    rng = np.random.default_rng([seed, num, 55])
    target = rng.uniform(size=(num, 3))
    rotation = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    rotation[:, 0] *= np.linalg.det(rotation)
    source = (target + noise * rng.standard_normal((num, 3))) @ rotation
    source -= source.mean(axis=0)
    return target - target.mean(axis=0), source[rng.permutation(num)[:num_source]]


def _points(shape, n, dim, rng):
    points = rng.uniform(-0.5, 0.5, size=(n, dim))
    if shape == "coplanar":
        points[:, -1] = 0.0
    elif shape == "collinear":
        points = points[:, :1] * rng.standard_normal(dim)
    elif shape == "symmetric":
        half = points[: (n + 1) // 2]
        points = np.concatenate([half, half * np.where(np.arange(dim) < 2, -1.0, 1.0)])[:n]
    elif shape == "repeated":
        points = points[rng.integers(0, max(1, n // 2), size=n)]
    elif shape == "one place":
        points[:] = points[0]
    return points
