"""Joint bounds, checked again: against brute force over all maps, and against arrangements; damage is refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.rotations import random_rotation
from pairwise.branch_and_bound.tilted import TiltedProof, prove_tilted
from pairwise.certificates.verify_joint import gram_bound, gram_matrix, largest_turns, tilted_bound
from pairwise.problem.problem import energy_scale
from tests.pairwise.branch_and_bound.test_tilted import least_tilted, tilted_problem
from tests.rigid_problems import small_problem

FLAT = next(seed for seed in range(40) if small_problem(seed, max_target=5).dim == 2)
SPATIAL = [seed for seed in range(40) if small_problem(seed, max_target=5).dim == 3]


def cells_of(proof: TiltedProof) -> list[np.ndarray]:
    """The depths of the cells of each chirality."""
    return np.split(proof.depths, np.cumsum(proof.num_cells)[:-1])


@pytest.mark.parametrize("seed", SPATIAL)
def test_what_is_checked_again_lies_below_brute_force_and_not_below_the_proof(seed: int) -> None:
    problem, tilt = tilted_problem(seed)
    scale = energy_scale(problem) + float(np.abs(tilt).sum())
    proof = prove_tilted(problem, tilt, np.eye(3)[None], gap=1e-2 * scale, time_limit_s=20.0)
    bound = tilted_bound(problem, tilt, cells_of(proof))
    assert bound <= least_tilted(problem, tilt) + 1e-9 * scale
    assert bound >= proof.lower_bound - 1e-9 * scale
    whole = [np.zeros(4, dtype=np.uint8)] * len(proof.num_cells)
    assert tilted_bound(problem, tilt, whole) <= bound + 1e-9 * scale


def test_cells_that_do_not_tile_are_refused() -> None:
    problem, tilt = tilted_problem(SPATIAL[0])
    proof = prove_tilted(problem, tilt, np.eye(3)[None], gap=0.1 * energy_scale(problem))
    first, rest = cells_of(proof)[0], cells_of(proof)[1:]
    swapped = np.concatenate([first[1:], first[:1]])
    for wrong in (first[:-1], np.append(first, 0), first + 1, np.full_like(first, 99), swapped[swapped > 0][:0]):
        with pytest.raises(InputError, match="depths"):
            tilted_bound(problem, tilt, (wrong, *rest))
    with pytest.raises(InputError, match="chiralities"):
        tilted_bound(problem, tilt, ())
    with pytest.raises(InputError, match="space"):
        tilted_bound(small_problem(FLAT), tilt, cells_of(proof))


def multipliers(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    edges = np.array(list(itertools.combinations(range(5), 2)))
    return edges, rng.standard_normal((10, 3, 3)), 3.0 * rng.standard_normal((5, 3, 3))


def test_no_poses_fall_below_the_gram_bound_whatever_the_diagonal_and_some_come_near_a_good_one() -> None:
    rng = np.random.default_rng(0)
    edges, tilts, diagonal = multipliers(rng)
    frames = np.array([[random_rotation(rng, group="O") for _ in range(5)] for _ in range(2000)])
    values = (tilts * (np.swapaxes(frames[:, edges[:, 0]], 2, 3) @ frames[:, edges[:, 1]])).sum(axis=(1, 2, 3))
    assert gram_bound(edges, tilts, diagonal) <= values.min()
    known = frames[0]
    pulls = -np.swapaxes(known[edges[:, 0]], 1, 2) @ known[edges[:, 1]]
    tight = gram_bound(edges, pulls, np.tile(2.0 * np.eye(3), (5, 1, 1)))
    assert tight == pytest.approx(-30.0, abs=1e-9)
    assert np.array_equal(gram_matrix(edges, tilts, diagonal), gram_matrix(edges, tilts, diagonal).T)


def test_poses_within_the_gap_turn_no_farther_than_the_bound_and_it_is_met() -> None:
    rng = np.random.default_rng(1)
    edges, known = (
        np.array(list(itertools.combinations(range(5), 2))),
        np.array([random_rotation(rng) for _ in range(5)]),
    )
    pulls = -np.swapaxes(known[edges[:, 0]], 1, 2) @ known[edges[:, 1]]
    diagonal = np.tile(2.0 * np.eye(3), (5, 1, 1))
    for angle in (0.2, 0.6, 1.0):
        one = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
        # One shape turned: <L, G> rises from -30 by 4 pairs of 2 (1 - cos).
        risen = 8.0 * (1.0 - np.cos(angle))
        turns = largest_turns(edges, pulls, diagonal, known, -30.0 + risen)
        assert turns[0] >= angle
        assert turns[0] < 1.35 * angle
        moved = known.copy()
        moved[0] = one @ known[0]
        relative = np.swapaxes(moved[edges[:, 0]], 1, 2) @ moved[edges[:, 1]]
        assert (pulls * relative).sum() == pytest.approx(-30.0 + risen)
    assert largest_turns(edges, pulls, diagonal, known, 10.0) == pytest.approx(np.pi)
