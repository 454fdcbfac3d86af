"""Each oracle accepts the right answer and rejects wrong ones; the catalogue's answers agree with brute force."""

from dataclasses import replace

import numpy as np
import pytest

from pairwise.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from tests.oracles import (
    brute_force,
    check_pose,
    check_relaxation,
    in_rotation_hull,
    isometries,
)
from tests.problems import catalogue, chair, planted, random_rotation

CATALOGUE = catalogue()


@pytest.mark.parametrize("known", CATALOGUE, ids=lambda known: known.name)
def test_catalogue_agrees_with_brute_force(known):
    optimum = (
        brute_force(known.problem).energy
        if known.problem.num_target <= 7
        else known.problem.energy(*_isometric_pose(known))
    )
    if np.isnan(known.optimum):
        assert optimum > 1e-3
    else:
        assert optimum == pytest.approx(known.optimum, abs=1e-9)


def _isometric_pose(known):
    maps = isometries(known.problem.target, known.problem.source)
    rotations = [known.problem.procrustes(point_map) for point_map in maps]
    energies = [known.problem.energy(r, m) for r, m in zip(rotations, maps, strict=True)]
    best = int(np.argmin(energies))
    return rotations[best], maps[best]


def test_check_pose_rejects_wrong_poses(rng):
    problem = Problem.from_user(
        rng.random((5, 3)), rng.random((4, 3)), allowed=np.arange(5)[:, None] != np.arange(4)
    )
    best = brute_force(problem)
    pose, own, energy = best.rotation, best.point_map, best.energy
    diagonal = Problem.from_user(problem.target, problem.source, rotation_pattern=0)
    for reason, *wrong in (
        ("not orthogonal", problem, 1.01 * pose, own, energy),
        ("reflection", problem, np.diag([-1.0, 1.0, 1.0]) @ pose, own, energy),
        ("injective", problem, pose, own[[0, 0, 2, 3]], energy),
        ("allowed", problem, pose, np.arange(4), energy),
        ("energy", problem, pose, own, 0.99 * energy),
        ("pattern", diagonal, pose, own, energy),
    ):
        assert reason in str(check_pose(*wrong))


def test_check_relaxation_rejects_wrong_solutions(rng):
    problem = Problem.from_user(rng.random((4, 3)), rng.random((4, 3)))
    result = solve_pm_sdp(problem, solver="clarabel")
    assert check_relaxation(problem, result, 1e-5) == []
    for reason, wrong in (
        ("PSD", {"C": 0.9 * result.C}),
        ("C does not", {"C": 1.01 * result.C}),
        ("stochastic", {"X": 1.01 * result.X}),
        ("value", {"value": 0.9 * result.value}),
        ("hull", {"R": -np.eye(3)}),
    ):
        assert reason in str(check_relaxation(problem, replace(result, **wrong), 1e-5))
    masked = Problem.from_user(problem.target, problem.source, allowed=result.X.max() > result.X)
    assert "allowed" in str(check_relaxation(masked, result, 1e-5))


def test_rotation_hull_by_definition(rng):
    for dim in (2, 3):
        weights = rng.dirichlet(np.ones(4))
        inside = sum(w * random_rotation(rng, dim) for w in weights)
        assert in_rotation_hull(inside, 1e-9)
        assert not in_rotation_hull(random_rotation(rng, dim, reflected=True), 1e-3)
        assert not in_rotation_hull(1.01 * random_rotation(rng, dim), 1e-3)
    assert in_rotation_hull(np.diag([1.0, -1.0, -1.0]), 1e-9)
    assert in_rotation_hull(-np.eye(3) / 3.0, 1e-9)
    assert not in_rotation_hull(-np.eye(3) / 2.9, 1e-9)


def test_isometries_are_the_symmetries(rng):
    points = chair(rng)
    problem = planted(rng, points)
    assert len(isometries(points, problem.source)) == 2
    assert len(isometries(points, problem.source * 1.01)) == 0
    cube = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)], dtype=float)
    assert len(isometries(cube, cube)) == 48
