"""Proofs over rotations and shifts: against all maps of tiny problems, and bounds against poses in the cells."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import pairwise
from data_tools.arrays import FloatArray, IntArray
from data_tools.errors import OptionsError
from data_tools.rotations import random_rotation
from pairwise.branch_and_bound.motion_bounds import MotionBounds, MotionCells
from pairwise.branch_and_bound.motion_search import MotionSearch
from pairwise.branch_and_bound.motions import MotionProof, can_prove_motion, prove_motion
from pairwise.local.freedom import Freedom
from pairwise.local.local_search import energies_of, similarities
from pairwise.problem.chirality import chiralities
from pairwise.problem.problem import Problem
from pairwise.status import Status

SHIFTED = Freedom(translate=True)


def every_map(num_source: int, num_target: int, max_unmatched: int) -> IntArray:
    """Return all one-to-one maps that leave at most so many source points out, shape (m, k)."""
    maps = []
    for left_out in range(max_unmatched + 1):
        for matched in itertools.combinations(range(num_source), num_source - left_out):
            for images in itertools.permutations(range(num_target), len(matched)):
                row = np.full(num_source, -1)
                row[list(matched)] = images
                maps.append(row)
    return np.array(maps)


def best_of_all(problem: Problem) -> tuple[float, FloatArray, FloatArray]:
    """Return the least energy over all maps, each at its best rotation and shift, and these."""
    maps = every_map(problem.num_source, problem.num_target, problem.max_unmatched)
    if not problem.unmatched_cost and problem.max_unmatched:  # so many are matched, no more
        maps = maps[(maps < 0).sum(axis=1) == problem.max_unmatched]
    found = []
    for _, part in chiralities(problem, partial=True):
        rotations, scales, shifts = similarities(part, maps, SHIFTED)
        energies = energies_of(part, rotations, maps, scales, shifts)
        at = int(energies.argmin())
        found.append((float(energies[at]), rotations[at], shifts[at]))
    return min(found, key=lambda one: one[0])


def overlapping(seed: int, num: int = 5, *, noise: float = 0.1, **arguments: object) -> Problem:
    """Two parts of a noisy point set that share all points but one, one of them turned and shifted."""
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((num + 1, 3))
    source = points[1:] + noise * rng.standard_normal((num, 3))
    given = {"unmatched_penalty": rng.uniform(0.3, 0.8)} | arguments
    return Problem.from_user(points[:num], source @ random_rotation(rng).T + rng.standard_normal(3), **given)


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_tiny_problems_are_proven_and_agree_with_all_maps(seed: int) -> None:
    problem = overlapping(seed)
    proof, optimum = prove_motion(problem, tol=0.2), best_of_all(problem)[0]
    assert proof.status is Status.PROVEN_OPTIMAL
    assert proof.lower_bound <= optimum * (1 + 1e-9)
    assert proof.candidate.energy == pytest.approx(optimum, rel=1e-6)
    assert proof.lower_bound >= 0.8 * optimum - 1e-6
    pose = proof.candidate
    energy = energies_of(
        problem,
        pose.R_target_source[None],
        pose.map_target_source[None],
        np.ones(1),
        np.array(pose.translation)[None],
    )
    assert energy[0] == pytest.approx(pose.energy)
    assert "one-to-one map of the 5 source points" in proof.statement


@pytest.mark.parametrize(
    "arguments",
    [{"group": "O"}, {"unmatched_penalty": None, "num_matches": 4}],
    ids=["mirror images", "so many matches"],
)
def test_other_kinds_of_problems_agree_with_all_maps(arguments: dict[str, object]) -> None:
    problem = overlapping(3, **arguments)
    proof, optimum = prove_motion(problem, tol=0.2), best_of_all(problem)[0]
    assert proof.status is Status.PROVEN_OPTIMAL
    assert 0.8 * optimum - 1e-6 <= proof.lower_bound <= optimum * (1 + 1e-9)
    assert proof.candidate.energy == pytest.approx(optimum, rel=1e-6)


def violations(problem: Problem, bounds: MotionBounds, origin: FloatArray, rng: np.random.Generator) -> int:
    """Return how many cells around the optimum are bounded above its energy."""
    energy, rotation, shift = best_of_all(problem)
    num = 400
    angles, reaches = rng.uniform(0.01, 1.5, num), rng.uniform(0.01, 0.6, num)
    axes = rng.standard_normal((num, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turned = rng.uniform(0.5, 1.0, num) * angles
    offsets = rng.standard_normal((num, 3))
    offsets *= (rng.uniform(0.5, 1.0, num) * reaches / np.linalg.norm(offsets, axis=1))[:, None]
    cross = np.cross(np.eye(3)[None], axes[:, None])
    away = np.eye(3) + np.sin(turned)[:, None, None] * cross + (1 - np.cos(turned))[:, None, None] * cross @ cross
    cells = MotionCells(
        rotations=np.ascontiguousarray(rotation @ away),
        angles=angles,
        shifts=shift + rotation @ origin + offsets,
        reaches=reaches,
    )
    reach = bounds.reach(cells)
    quasi = bounds.quasi(cells, np.inf, np.zeros((num, bounds.num_columns)))[0]
    return int((np.maximum(reach, quasi) > energy * (1 + 1e-9)).sum())


def bounds_of(problem: Problem, *, at_mean: bool = False) -> tuple[MotionBounds, FloatArray]:
    """Return the bounds about a point, or about the mean of what the optimum matches."""
    left_out = int(best_of_all(problem)[0] / problem.unmatched_cost)
    origin = problem.source[:4].mean(axis=0) if at_mean else problem.source[1]
    return MotionBounds(problem, origin, left_out), origin


@pytest.mark.parametrize("at_mean", [False, True])
def test_no_cell_that_holds_the_optimum_is_bounded_above_it(at_mean: bool) -> None:
    for seed in range(5):
        problem = overlapping(seed)
        bounds, origin = bounds_of(problem, at_mean=at_mean)
        assert violations(problem, bounds, origin, np.random.default_rng(seed)) == 0


@pytest.mark.parametrize("factors", [(0.0, 1.0), (1.0, 0.0), (0.1, 0.1)], ids=["turns", "shifts", "both"])
def test_bounds_that_promise_too_much_are_noticed(
    factors: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    losses = MotionBounds.losses

    def too_small(self: MotionBounds, cells: MotionCells) -> tuple[FloatArray, FloatArray]:
        turn, match = losses(self, cells)
        return factors[0] * turn, factors[1] * match

    monkeypatch.setattr(MotionBounds, "losses", too_small)
    found = 0
    for seed in range(5):
        problem = overlapping(seed)
        bounds, origin = bounds_of(problem, at_mean=True)
        found += violations(problem, bounds, origin, np.random.default_rng(seed))
    assert found > 20


def test_one_of_the_anchors_of_a_better_pose_lies_within_reach() -> None:
    for seed in range(8):
        problem = overlapping(seed, noise=0.15)
        search = MotionSearch(problem, reflected=False, tol=1e-2)
        search.start([])
        anchors = search._anchors(np.inf)
        _, rotation, shift = best_of_all(problem)
        moved = problem.source[anchors] @ rotation.T + shift
        gaps = np.linalg.norm(moved[:, None] - problem.target, axis=2).min()
        assert gaps <= search._reach(len(anchors), np.inf) * (1 + 1e-9)


def test_a_larger_planted_overlap_is_found_and_proven_by_matching() -> None:
    problem = overlapping(1, 8, noise=0.05, unmatched_penalty=0.3)
    result = pairwise.match(
        problem.target,
        problem.source,
        unmatched_penalty=0.3,
        options=pairwise.MatchOptions(estimate_translation=True, certify=True, gap_tol=0.2),
    )
    assert result.status is Status.PROVEN_OPTIMAL
    assert 0.8 * result.energy - 1e-6 <= result.lower_bound <= result.energy
    assert result.map_target_source.tolist() == [*range(1, 8), -1]


def test_a_proof_that_had_no_time_says_so() -> None:
    proof = prove_motion(overlapping(0, 12), time_limit_s=1e-6)
    assert proof.status is Status.TIME_LIMIT
    assert proof.lower_bound == 0.0
    assert proof.statement.startswith("Not proven")
    assert isinstance(proof, MotionProof)


def test_what_is_not_for_it_is_refused() -> None:
    rng = np.random.default_rng(0)
    flat = Problem.from_user(rng.random((4, 2)), rng.random((4, 2)))
    weighted = Problem.from_user(rng.random((4, 3)), rng.random((4, 3)), weights=[1, 1, 2, 1])
    for problem in (flat, weighted):
        assert not can_prove_motion(problem)
        with pytest.raises(OptionsError, match="rotations and shifts"):
            prove_motion(problem)
    with pytest.raises(OptionsError, match="tol"):
        prove_motion(overlapping(0), tol=0.0)
    with pytest.raises(OptionsError, match="no bounds are known for scales"):
        pairwise.MatchOptions(estimate_scale=True, certify=True)
    untried = pairwise.match(
        flat.target, flat.source, options=pairwise.MatchOptions(estimate_translation=True, certify=True)
    )
    assert np.isnan(untried.lower_bound)


def test_allowed_matches_and_constant_costs_are_kept_to() -> None:
    problem = overlapping(4)
    allowed = np.ones((5, 5), dtype=bool)
    allowed[2, 0] = False
    limited = replace(problem, allowed=allowed, constant_cost=np.full((5, 5), 0.01))
    proof, optimum = prove_motion(limited, tol=0.2), _best_allowed(limited)
    assert proof.candidate.map_target_source[0] != 2
    assert proof.candidate.energy == pytest.approx(optimum, rel=1e-6)


def _best_allowed(problem: Problem) -> float:
    maps = every_map(5, 5, problem.max_unmatched)
    maps = maps[maps[:, 0] != 2]
    rotations, scales, shifts = similarities(problem, maps, SHIFTED)
    return float(energies_of(problem, rotations, maps, scales, shifts).min())
