"""The joint lower bound: against brute force and arrangements, and its parts against what they must be."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.tools.certify.result import PairEnergies
from collalign.tools.certify.rounds import (
    MOST_ROWS,
    TUNED,
    JointMaster,
    Rounds,
    bound_arrangements,
    problem_of,
)
from data_tools.rotations import random_rotation
from pairwise.branch_and_bound.tilted import prove_tilted
from pairwise.local_search import energies_of


def planted(num_shapes, num_points, noise, *, group="SO", seed=0, invariants=0.0):
    """Noisy, turned, shuffled copies of one cloud, every pair of them."""
    rng = np.random.default_rng(seed)
    cloud = rng.standard_normal((num_points, 3))
    samples = [
        (
            (cloud + noise * rng.standard_normal(cloud.shape))[rng.permutation(num_points)]
            @ random_rotation(rng, group=group),
            invariants * rng.standard_normal((num_points, 1)),
        )
        for _ in range(num_shapes)
    ]
    edges = np.array(list(itertools.combinations(range(num_shapes), 2)))
    problems = [problem_of(samples[i], samples[j], group) for i, j in edges.tolist()]
    keys = tuple(map(str, range(num_shapes)))
    with Session.open(AlignOptions(group=group), RunOptions(jobs=1)) as session:
        return Rounds(
            session=session,
            samples=samples,
            keys=keys,
            energies=PairEnergies(num_shapes, edges, problems),
            candidates=[np.zeros((0, 3, 3))] * len(edges),
        )


def certified(rounds, budget_s=3600.0):
    """The joint bound, from random poses."""
    frames = random_frames(rounds.energies.num_shapes, np.random.default_rng(1))
    with Session.open(rounds.session.options, RunOptions(jobs=1)) as session:
        return bound_arrangements(replace(rounds, session=session), frames, budget_s)


def random_frames(num, rng, group="SO"):
    return np.array([random_rotation(rng, group=group) for _ in range(num)])


def cheapest_of_all_maps(energies, known):
    """The least energy by every choice of maps that may cost less than a known arrangement, from several starts.

    A choice whose pairs cost more even if each has its own best rotation is left out.
    """
    every = np.array(list(itertools.permutations(range(energies.problems[0].num_source))))
    least, moments = [], []
    for problem in energies.problems:
        moments.append(np.swapaxes(problem.target[every], 1, 2) @ problem.source)
        least.append(energies_of(problem, problem.pattern.project(moments[-1]), every))
    sums, choices = np.zeros(1), np.zeros((1, 0), dtype=np.int64)
    for pair, values in enumerate(least):
        totals = sums[:, None] + values
        rest = sum(float(others.min()) for others in least[pair + 1 :])
        chosen, maps = np.nonzero(totals + rest < known.energy * (1 + 1e-9))
        sums, choices = totals[chosen, maps], np.column_stack([choices[chosen], maps])
    rng, best = np.random.default_rng(3), np.inf
    group = "SO" if energies.pattern.special_blocks else "O"
    starts = [known.frames, random_frames(energies.num_shapes, rng, group)]
    for choice in choices:
        pulls = np.array([some[one] for some, one in zip(moments, choice, strict=True)])
        for start in starts:
            relative = energies.relative(energies._sweep(start, pulls))
            values = zip(energies.problems, relative, every[choice], strict=True)
            best = min(
                best, sum(problem.energy(rotation, one) for problem, rotation, one in values)
            )
    return best


@pytest.mark.parametrize(
    ("num_shapes", "num_points", "group", "invariants", "noise"),
    [
        (3, 3, "SO", 0.0, 0.5),
        (3, 3, "O", 0.3, 0.5),
        (3, 5, "SO", 0.3, 0.2),
        (4, 4, "O", 0.3, 0.2),
    ],
)
def test_brute_force_over_all_maps_finds_nothing_below_the_bound(
    num_shapes, num_points, group, invariants, noise
):
    rounds = planted(
        num_shapes, num_points, noise, group=group, seed=num_points, invariants=invariants
    )
    found = certified(rounds)
    least = cheapest_of_all_maps(rounds.energies, found)
    assert found.bound <= least * (1 + 1e-9)
    assert least == pytest.approx(found.energy, rel=0.05)
    assert found.share > 0.75
    assert least < rounds.energies.at(random_frames(num_shapes, np.random.default_rng(8))).sum()


@pytest.mark.parametrize("group", ["SO", "O"])
def test_no_arrangement_costs_less_than_the_bound(group):
    rounds = planted(4, 8, 0.25, group=group)
    energies, rng = rounds.energies, np.random.default_rng(2)
    found = certified(rounds)
    others = [energies.descend(random_frames(4, rng, group)) for _ in range(60)]
    cheapest = min(energy for _, energy in others)
    assert found.bound <= cheapest * (1 + 1e-9)
    assert found.share >= 0.75
    alone = JointMaster(
        4, energies.edges, energies.relative(found.frames), energies.at(found.frames), 1.0
    )
    pair_sum = sum(
        prove_tilted(problem, tilt, found.frames[:1], gap=1e-3).lower_bound
        for problem, tilt in zip(energies.problems, alone.tilts, strict=True)
    )
    assert found.bound > pair_sum


def test_pairs_that_no_time_was_left_for_take_from_the_bound_no_more_than_they_must(monkeypatch):
    rounds = planted(3, 7, 0.25)
    one_round = TUNED._replace(most_rounds=1)
    monkeypatch.setattr("collalign.tools.certify.rounds.TUNED", one_round)
    whole = certified(rounds)
    assert certified(rounds, budget_s=1e-9).bound == 0.0
    monkeypatch.setattr(
        "collalign.engine.session.takewhile", lambda _, tasks: itertools.islice(tasks, 2)
    )
    some = certified(rounds)
    assert 0.0 < some.bound < whole.bound
    assert (some.proof["num_cells"].max(axis=1) > 4).sum() == 2


def test_the_energy_of_an_arrangement_is_that_of_its_pairs_and_descent_never_raises_it():
    energies = planted(3, 7, 0.3, seed=5).energies
    frames = random_frames(3, np.random.default_rng(6))
    i, j = energies.edges[1]
    costs = [
        energies.problems[1].energy(frames[i].T @ frames[j], np.array(point_map))
        for point_map in itertools.permutations(range(7))
    ]
    assert energies.at(frames)[1] == pytest.approx(min(costs))
    found, energy = energies.descend(frames)
    assert energy <= energies.at(frames).sum()
    assert energy == pytest.approx(energies.at(found).sum())
    assert energies.perturb((found, energy), np.random.default_rng(7), 10)[1] <= energy


def test_too_many_shapes_for_multipliers_are_bounded_pair_by_pair(monkeypatch):
    monkeypatch.setattr("collalign.tools.certify.rounds.MOST_ROWS", 6)
    found = certified(planted(3, 5, 0.3))
    assert not found.proof["tilts"].any()
    assert found.ended == "too-many"
    assert 0.3 < found.share <= 1.0
    assert MOST_ROWS > 6
