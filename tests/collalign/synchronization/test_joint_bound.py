"""The joint lower bound: its parts against what they must bound, and arrangements against each other."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from collalign.synchronization.bound.arrangement import PairEnergies
from collalign.synchronization.bound.master import MOST_ROWS, JointMaster, Multipliers
from collalign.synchronization.bound.simplex import combine
from data_tools.errors import OptionsError
from data_tools.rotations import random_rotation, rotation_angle_deg
from pairwise.branch_and_bound.tilted import prove_tilted
from pairwise.problem.problem import Problem


def planted(num_shapes: int, num_points: int, noise: float, *, group: str = "SO", seed: int = 0) -> PairEnergies:
    """Noisy, turned, shuffled copies of one cloud, every pair of them."""
    rng = np.random.default_rng(seed)
    cloud = rng.standard_normal((num_points, 3))
    shapes = [
        (cloud + noise * rng.standard_normal(cloud.shape))[rng.permutation(num_points)]
        @ random_rotation(rng, group=group)
        for _ in range(num_shapes)
    ]
    edges = np.array(list(itertools.combinations(range(num_shapes), 2)))
    return PairEnergies(
        num_shapes, edges, [Problem.from_user(shapes[i], shapes[j], group=group) for i, j in edges.tolist()]
    )


def random_frames(num: int, rng: np.random.Generator, group: str = "SO") -> NDArray[np.float64]:
    return np.array([random_rotation(rng, group=group) for _ in range(num)])


def rounds(energies: PairEnergies, num: int) -> tuple[list[float], list[Multipliers], JointMaster]:
    """The joint bounds of some rounds, from random poses."""
    start = energies.descend(random_frames(energies.num_shapes, np.random.default_rng(1)))
    relative, values = energies.relative(start.frames), energies.at(start.frames)
    unit = float(values.mean()) + 1e-6
    master = JointMaster(energies.num_shapes, energies.edges, relative, values, unit=unit)
    tilts, gram_bound = np.zeros_like(relative), 0.0
    bounds, multipliers = [], []
    for number in range(num):
        proofs = [
            prove_tilted(problem, tilt, master.used(pair), gap=1e-3 * unit)
            for pair, (problem, tilt) in enumerate(zip(energies.problems, tilts, strict=True))
        ]
        bounds.append(gram_bound + sum(proof.lower_bound for proof in proofs))
        for pair, proof in enumerate(proofs):
            master.add(pair, proof.rotations, proof.energies)
        if number < num - 1:
            multipliers.append(master.run())
            tilts, gram_bound = multipliers[-1].tilts, multipliers[-1].gram_bound
    return bounds, multipliers, master


@pytest.mark.parametrize("group", ["SO", "O"])
def test_no_arrangement_costs_less_than_the_bound_of_any_round(group: str) -> None:
    energies = planted(4, 8, 0.35, group=group)
    bounds, multipliers, master = rounds(energies, 9)
    rng = np.random.default_rng(2)
    found = [energies.descend(random_frames(4, rng, group)) for _ in range(60)]
    cheapest = min(one.energy for one in found)
    assert max(bounds) <= cheapest * (1 + 1e-9)
    assert max(bounds) > 1.02 * bounds[0]
    assert max(bounds) >= 0.75 * cheapest
    assert max(bounds) <= max(one.column_bound for one in multipliers) + 1e-9
    assert np.linalg.eigvalsh(master.gram).min() > -1e-9


def test_the_gram_bound_holds_for_every_arrangement_and_not_for_larger_multipliers() -> None:
    energies = planted(5, 6, 0.4, seed=3)
    _, multipliers, _ = rounds(energies, 3)
    rng, last = np.random.default_rng(4), multipliers[-1]
    frames = [random_frames(5, rng, "O") for _ in range(200)]
    least = min(float((last.tilts * energies.relative(some)).sum()) for some in frames)
    for some in frames[:20]:
        best = energies._sweep(some, -last.tilts)
        least = min(least, float((last.tilts * energies.relative(best)).sum()))
    assert last.gram_bound <= least
    assert last.gram_bound > 2.0 * least


def test_the_energy_of_an_arrangement_is_that_of_its_pairs_and_descent_never_raises_it() -> None:
    energies = planted(3, 7, 0.3, seed=5)
    frames = random_frames(3, np.random.default_rng(6))
    i, j = energies.edges[1]
    costs = [
        energies.problems[1].energy(frames[i].T @ frames[j], np.array(point_map))
        for point_map in itertools.permutations(range(7))
    ]
    assert energies.at(frames)[1] == pytest.approx(min(costs))
    found = energies.descend(frames)
    assert found.energy <= energies.at(frames).sum()
    assert found.energy == pytest.approx(energies.at(found.frames).sum())
    better = energies.perturb(found, np.random.default_rng(7), 10)
    assert better.energy <= found.energy


def test_copies_without_noise_are_arranged_by_rounding_the_gram_matrix() -> None:
    energies = planted(4, 8, 0.0, seed=8)
    bounds, _, master = rounds(energies, 6)
    found = energies.descend(energies.rounded(master.gram))
    assert found.energy == pytest.approx(0.0, abs=1e-9)
    assert max(bounds) == pytest.approx(0.0, abs=1e-6)
    turned = found.frames @ random_rotation(np.random.default_rng(9))
    assert not np.allclose(energies.at(turned).sum(), 0.0, atol=1e-3)
    gauge = random_rotation(np.random.default_rng(10)) @ found.frames
    assert energies.at(gauge).sum() == pytest.approx(0.0, abs=1e-9)
    assert rotation_angle_deg(energies.relative(gauge), energies.relative(found.frames)).max() < 1e-4


def test_shares_solve_the_least_squares_problem_of_every_group() -> None:
    rng = np.random.default_rng(11)
    sizes = [1, 4, 7]
    starts = np.cumsum([0, *sizes])
    points, costs, wanted = rng.standard_normal((12, 9)), rng.random(12), rng.standard_normal((3, 9))
    shares = np.concatenate([np.eye(size)[0] for size in sizes])
    for _ in range(20):
        combine(points, costs, starts, wanted, 0.7, shares)
    for group, (first, last) in enumerate(itertools.pairwise(starts)):
        own, cost, goal = points[first:last], costs[first:last], wanted[group]

        def objective(
            share: NDArray[np.float64], own: object = own, cost: object = cost, goal: object = goal
        ) -> float:
            return float(cost @ share + 0.7 * ((own.T @ share - goal) ** 2).sum())  # type: ignore[attr-defined]

        reference = minimize(
            objective,
            np.full(last - first, 1.0 / (last - first)),
            bounds=[(0.0, 1.0)] * (last - first),
            constraints={"type": "eq", "fun": lambda share: share.sum() - 1.0},
        )
        found = shares[first:last]
        assert found.min() >= 0.0
        assert found.sum() == pytest.approx(1.0)
        assert objective(found) <= reference.fun + 1e-6
        assert objective(np.full(len(found), 1.0 / len(found))) >= objective(found)


def test_too_many_shapes_are_refused_with_advice() -> None:
    num = MOST_ROWS // 3 + 1
    with pytest.raises(OptionsError, match="name some of them"):
        JointMaster(num, np.array([[0, 1]]), np.eye(3)[None], np.ones(1), unit=1.0)
