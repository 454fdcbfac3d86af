import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from data_tools.rotations import rotation_angles
from pairwise.branch_and_bound.bounds import QuasiBounds
from pairwise.local.rotation_sets import random_rotations
from pairwise.problem.chirality import chiralities
from pairwise.problem.problem import Problem, energy_scale
from tests.oracles import every_pose
from tests.rigid_problems import planted_cube, rigid_problem


def evaluate(problem, rotations, radii, threshold=np.inf):
    """Bounds from zero potentials."""
    bounds = QuasiBounds(problem)
    zeros = np.zeros(len(rotations), dtype=np.int64)
    return bounds(rotations, radii, threshold, np.zeros((1, problem.num_target)), zeros)


def least_energy(problem, rotation):
    """The best energy of any map at a rotation."""
    costs = problem.assignment_costs(rotation)
    return costs[linear_sum_assignment(costs)].sum()


@pytest.mark.parametrize("seed", range(24))
def test_quasi_bounds_are_below_every_procrustes_pose_in_the_ball(seed):
    _, problem = chiralities(rigid_problem(seed))[-1]
    rng = np.random.default_rng(seed)
    energies, poses, _ = every_pose(problem)
    rotations = np.concatenate([random_rotations(problem.dim, 12, rng), poses[rng.integers(len(poses), size=4)]])
    radii = rng.choice([1e-4, 0.02, 0.2, 0.7, 2.0], len(rotations))
    found = evaluate(problem, rotations, radii)
    inside = rotation_angles(poses, rotations[:, None]) <= radii[:, None]
    least = np.where(inside, energies, np.inf).min(axis=1)
    assert (found.bounds <= least + 1e-12 * energy_scale(problem)).all()


def test_the_loss_is_all_that_a_turn_about_the_shortest_axis_costs():
    points = np.array([[3.0, 0, 0], [-3.0, 0, 0], [0, 2.0, 0], [0, -2.0, 0], [0, 0, 1.0], [0, 0, -1.0]])
    for angle in (1e-3, 0.02, 0.2):
        turn = Rotation.from_euler("z", angle).as_matrix()
        found = evaluate(Problem.from_user(points, points), turn[None], np.array([angle]))
        assert found.bounds[0] == pytest.approx(0.0, abs=1e-9)


def test_what_a_mask_forbids_is_not_what_is_bounded():
    target, source = planted_cube(6, 0.1, 0)
    allowed = np.roll(np.eye(6, dtype=bool), 1, axis=0)
    problem = Problem.from_user(target, source, allowed=allowed)
    best = least_energy(problem, np.eye(3))
    assert evaluate(problem, np.eye(3)[None], np.zeros(1)).bounds[0] == pytest.approx(best)


def test_the_bound_is_no_bound_of_the_energy_in_the_ball():
    problem = Problem.from_user(*planted_cube(6, 0.3, 1))
    rng = np.random.default_rng(0)
    rotations = random_rotations(3, 1000, rng)
    costs = np.array([least_energy(problem, rotation) for rotation in rotations])
    found = evaluate(problem, rotations, np.full(len(rotations), 0.3))
    near = rotation_angles(rotations[:, None], rotations) <= 0.3
    assert (found.bounds > np.where(near, costs, np.inf).min(axis=1)).any()


def test_the_bound_approaches_the_energy_with_the_square_of_the_radius():
    problem = Problem.from_user(*planted_cube(10, 0.02, 1))
    energies = []
    for radius in (1e-2, 1e-3):
        least = least_energy(problem, np.eye(3))
        found = evaluate(problem, np.eye(3)[None], np.array([radius]), least)
        energies.append(least - found.bounds[0])
    assert energies[0] == pytest.approx(100 * energies[1], rel=0.1)


def test_improving_stops_at_the_threshold_and_the_potentials_prove_the_bound():
    problem = Problem.from_user(*planted_cube(20, 0.2, 3))
    rotations = random_rotations(3, 50, np.random.default_rng(1))
    radii = np.full(50, 0.1)
    full = evaluate(problem, rotations, radii)
    threshold = float(np.median(full.bounds))
    short = evaluate(problem, rotations, radii, threshold)
    done = np.isinf(short.energies)
    assert 10 < done.sum() < 40
    assert (short.bounds[done] > threshold).all()
    assert (full.energies[~done] >= short.bounds[~done]).all()
    costs = problem.assignment_costs(rotations)
    v = short.potentials
    proven = (costs - v[:, :, None]).min(axis=1).sum(axis=1) + v.sum(axis=1)
    loss = QuasiBounds(problem).loss(radii)
    np.testing.assert_allclose(short.bounds, proven - loss, atol=1e-9)
