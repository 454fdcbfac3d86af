"""Branch and bound of an energy less a linear function of the rotation, against brute force over all maps."""

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.rotations import random_rotation
from pairwise.branch_and_bound.tilted import least_energies, prove_tilted, with_tilt
from pairwise.certificates.verify_cells import tilted_bound
from pairwise.problem import energy_scale
from tests.oracles import brute_force, every_pose
from tests.rigid_problems import small_problem


def least_tilted(problem, tilt):
    """The least of F(R) - <tilt, R>: for a fixed map it is linear in R, so every map's best R is a projection."""
    _, _, maps = every_pose(problem)
    values = []
    for point_map in maps:
        moment = problem.target[point_map].T @ (problem.weights[:, None] * problem.source)
        rotation = problem.pattern.project(moment + 0.5 * tilt)
        values.append(problem.energy(rotation, point_map) - float((tilt * rotation).sum()))
    return min(values)


def tilted_problem(seed):
    problem = small_problem(seed, max_target=5)
    rng = np.random.default_rng([seed, 8])
    strength = energy_scale(problem) * rng.choice([0.01, 0.3, 3.0])
    return problem, strength * rng.standard_normal((problem.dim, problem.dim))


@pytest.mark.parametrize("seed", range(28))
def test_the_energy_changes_by_the_linear_term_and_a_constant(seed):
    problem, tilt = tilted_problem(seed)
    tilted, offset = with_tilt(problem, tilt)
    rng, dim = np.random.default_rng(seed), problem.dim
    best = brute_force(problem)
    longer = np.append(best.point_map, problem.num_target + np.arange(dim))
    for group in ("SO", "O"):
        rotation = random_rotation(rng, dim, group=group)
        wanted = problem.energy(rotation, best.point_map) - float((tilt * rotation).sum()) + offset
        assert tilted.energy(rotation, longer) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("seed", range(28))
def test_the_bound_lies_within_the_gap_below_the_least_value_of_brute_force(seed):
    problem, tilt = tilted_problem(seed)
    scale = energy_scale(problem) + float(np.abs(tilt).sum())
    known = np.eye(problem.dim)[None]
    found, least = (
        prove_tilted(problem, tilt, known, gap=1e-3 * scale, time_limit_s=600.0),
        least_tilted(problem, tilt),
    )
    assert found.lower_bound <= least + 1e-9 * scale
    assert found.lower_bound >= least - 1.01e-3 * scale
    values = found.energies - (tilt * found.rotations).sum(axis=(1, 2))
    assert values.min() <= least + 1.01e-3 * scale
    assert found.energies == pytest.approx(least_energies(problem, found.rotations))
    cells = np.split(found.depths, np.cumsum(found.num_cells)[:-1])
    verified = tilted_bound(problem, tilt, cells)
    assert found.lower_bound - 1e-9 * scale <= verified <= least + 1e-9 * scale
    whole = [np.zeros(4 if problem.dim == 3 else 1, dtype=np.uint8)] * len(cells)
    assert tilted_bound(problem, tilt, whole) <= verified + 1e-9 * scale
    with pytest.raises(InputError, match="chiralities"):
        tilted_bound(problem, tilt, ())
