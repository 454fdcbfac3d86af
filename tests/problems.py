"""A catalogue of small Procrustes matching problems with known answers, shared by the tests of every solver."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pairwise.problem import Problem
from pairwise.rotation_search import explore, look_around


@dataclass(frozen=True)
class KnownProblem:
    """A problem, its optimal energy (NaN if only brute force knows it) and how many exact solutions it has.

    ``num_solutions`` is 0 where no pose has zero energy and -1 where the exact solutions form a continuum.
    """

    name: str
    problem: Problem
    optimum: float
    num_solutions: int


def random_rotation(rng, dim, *, reflected=False):
    """A matrix drawn uniformly from SO(d), or from the reflections."""
    matrix, upper = np.linalg.qr(rng.standard_normal((dim, dim)))
    matrix = matrix * np.sign(np.diag(upper))
    if (np.linalg.det(matrix) < 0) != reflected:
        matrix[:, 0] *= -1.0
    return matrix


def search(problem):
    """The local minima that :func:`pairwise.match` finds of rigid poses."""
    return look_around(problem, explore(problem))


def planted(rng, points, *, num_source=None, rotation=None, noise=0.0, **options):
    """A problem whose source is a rotated, relabelled, noisy part of the target; the map is drawn at random."""
    rotation = random_rotation(rng, points.shape[1]) if rotation is None else rotation
    kept = rng.permutation(len(points))[: num_source or len(points)]
    source = points[kept] @ rotation + noise * rng.standard_normal((len(kept), points.shape[1]))
    return Problem.from_user(points, source, **options)


def in_unit(problem, unit):
    """Return a problem with its points in another unit of length."""
    return replace(
        problem,
        target=unit * problem.target,
        source=unit * problem.source,
        constant_cost=unit**2 * problem.constant_cost,
    )


def chair(rng, num_half=3):
    """Points with one mirror plane and no other symmetry, shape (2 * num_half, 3)."""
    half = rng.random((num_half, 3)) + np.array([0.2, 0.0, 0.0])
    return np.concatenate([half, half * [-1.0, 1.0, 1.0]])


def table(rng, num_quarter=2):
    """Points with two mirror planes and the half turn that they compose to, shape (4 * num_quarter, 3)."""
    quarter = rng.random((num_quarter, 3)) + np.array([0.2, 0.5, 0.0])
    return np.concatenate([quarter * [a, b, 1.0] for a in (1.0, -1.0) for b in (1.0, -1.0)])


def catalogue(seed=7):
    """Every kind of problem once: groups, patterns, masks, weights, constants, symmetric and degenerate shapes."""
    return [*_exact(seed), *_degenerate(seed), *_noisy(seed)]


def _exact(seed):
    rng = np.random.default_rng(seed)
    cloud, flat, deep = (
        rng.standard_normal((6, 3)),
        rng.standard_normal((5, 2)),
        rng.standard_normal((6, 5)),
    )
    diagonal = np.diag(rng.choice([-1.0, 1.0], 4))
    blocks = np.zeros((5, 5))
    blocks[:3, :3], blocks[3:, 3:] = (
        random_rotation(rng, 3),
        random_rotation(rng, 2, reflected=True),
    )
    mirror = random_rotation(rng, 3, reflected=True)
    return [
        KnownProblem("rotation", planted(rng, cloud), 0.0, 1),
        KnownProblem("injective", planted(rng, cloud, num_source=4), 0.0, 1),
        KnownProblem("plane", planted(rng, flat), 0.0, 1),
        KnownProblem("mirrored", planted(rng, cloud, rotation=mirror, group="O"), 0.0, 1),
        KnownProblem(
            "diagonal",
            planted(rng, deep[:, :4], rotation=diagonal, rotation_pattern=0, group="O"),
            0.0,
            1,
        ),
        KnownProblem(
            "blocks", planted(rng, deep, rotation=blocks, rotation_pattern=[3, 2]), 0.0, 1
        ),
        KnownProblem("weights", planted(rng, cloud, weights=rng.random(6) + 0.1), 0.0, 1),
        KnownProblem("chair", planted(rng, chair(rng), group="O"), 0.0, 2),
        KnownProblem("chair turned", planted(rng, chair(rng)), 0.0, 1),
        KnownProblem("table", planted(rng, table(rng), group="O"), 0.0, 4),
        KnownProblem("table turned", planted(rng, table(rng)), 0.0, 2),
    ]


def _degenerate(seed):
    rng = np.random.default_rng(seed + 1)
    cloud = rng.standard_normal((5, 3))
    coplanar, collinear = cloud * [1.0, 1.0, 0.0], cloud * [1.0, 0.0, 0.0]
    apart = Problem.from_user([[3.0, 0.0, 0.0], [0.0, 7.0, 0.0]], [[0.0, 0.0, 2.0]])
    return [
        KnownProblem("one point", apart, 1.0, 0),
        KnownProblem("coplanar", planted(rng, coplanar, group="O"), 0.0, 2),
        KnownProblem("collinear", planted(rng, collinear), 0.0, -1),
        KnownProblem("all equal", planted(rng, np.ones((4, 3))), 0.0, -1),
        KnownProblem("all zero", Problem.from_user(np.zeros((3, 3)), np.zeros((3, 3))), 0.0, -1),
        KnownProblem("repeated", planted(rng, cloud[[0, 0, 1, 2, 3]]), 0.0, 1),
    ]


def _noisy(seed):
    rng = np.random.default_rng(seed + 2)
    cloud, deep = rng.random((5, 3)), rng.random((5, 4))
    mask = np.ones((5, 4), bool)
    mask[rng.permutation(5)[:2], [0, 2]] = False
    invariants = (rng.random((5, 2)), rng.random((5, 2)))
    options = {
        "noise": {},
        "noise O": {"group": "O"},
        "noise injective": {"num_source": 3},
        "noise masked": {"num_source": 4, "allowed": mask},
        "noise weights": {"weights": rng.random(5)},
        "noise invariants": {"invariants": invariants},
    }
    noisy = [
        KnownProblem(name, planted(rng, cloud, noise=0.1, **kw), math.nan, 0)
        for name, kw in options.items()
    ]
    noisy.append(
        KnownProblem(
            "noise blocks", planted(rng, deep, noise=0.1, rotation_pattern=[3, 1]), math.nan, 0
        )
    )
    noisy.append(
        KnownProblem(
            "noise diagonal",
            planted(rng, deep, noise=0.1, rotation_pattern=0, group="O"),
            math.nan,
            0,
        )
    )
    return noisy
