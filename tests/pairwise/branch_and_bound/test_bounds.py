from itertools import product

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from pairwise.branch_and_bound.bounds import Cells, Curvature, QuasiBounds
from pairwise.problem import Problem, chiralities, energy_scale
from pairwise.rotation_sets import random_rotations
from tests.oracles import every_pose
from tests.rigid_problems import planted_cube, rigid_problem

#: More than any energy.
MUCH = 1e9


def evaluate(problem, rotations, reach, threshold=MUCH):
    """Bounds of cells with corners at reach (m, c, 3), no map being known."""
    return QuasiBounds(problem)(rotations, reach, threshold)


def cubes(radius, num):
    """The corners of cubes of rotation vectors of a half diagonal in radians."""
    signs = np.array(list(product([-1.0, 1.0], repeat=3))) / np.sqrt(3.0)
    return np.repeat(np.sin(0.5 * radius) * signs[None], num, axis=0)


def is_inside(cells, rotations):
    """Whether rotations lie in cells, shape (m, p)."""
    if rotations.shape[1] == 2:
        u, faces = (
            np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])[:, None] / np.pi,
            np.zeros(len(rotations)),
        )
    else:
        quaternions = Rotation.from_matrix(rotations).as_quat()[:, [3, 0, 1, 2]]
        faces = np.abs(quaternions).argmax(axis=1)
        u = [np.delete(q / q[face], face) for q, face in zip(quaternions, faces, strict=True)]
        u = 4.0 / np.pi * np.arctan(np.array(u))
    near = np.abs(u - cells.centres[:, None]) <= cells.halves[:, None] + 1e-12
    return near.all(axis=2) & (cells.faces[:, None] == faces)


def least_energy(problem, rotation):
    """The best energy of any map at a rotation."""
    costs = problem.assignment_costs(rotation)
    return costs[linear_sum_assignment(costs)].sum()


@pytest.mark.parametrize("seed", range(24))
def test_quasi_bounds_are_below_every_procrustes_pose_in_the_cell(seed):
    _, problem = chiralities(rigid_problem(seed))[-1]
    rng, (energies, poses, _) = np.random.default_rng(seed), every_pose(problem)
    cells = Cells.whole(problem.dim)
    assert is_inside(cells, poses).any(axis=0).all()
    for _ in range(14):
        inside = is_inside(cells, poses)
        found = evaluate(problem, *cells.reach())
        assert found[2].all()
        least = np.where(inside, energies, np.inf).min(axis=1)
        assert (found[0] <= least + 1e-12 * energy_scale(problem)).all()
        children = cells.take(np.flatnonzero(inside.any(axis=1))).split()
        cells = children.take(rng.permutation(len(children))[:60])


def test_the_loss_is_as_large_as_the_curvature_where_that_is_largest(rng):
    sums = [points.T @ points for points in rng.standard_normal((2, 5, 3)) * [3.0, 2.0, 1.0]]
    curvature = Curvature(*sums)
    (_, own), (_, other) = map(np.linalg.eigh, (curvature._source, curvature._target))
    other[:, 1] *= np.linalg.det(own) * -np.linalg.det(other)
    worst = other @ own[:, ::-1].T
    reach = 0.7 * own[:, -1]
    form = curvature._source - worst.T @ curvature._target @ worst
    assert np.linalg.det(worst) == pytest.approx(1.0)
    assert curvature.losses(worst[None], reach[None, None])[0] >= reach @ form @ reach


def test_what_a_mask_forbids_is_not_what_is_bounded():
    target, source = planted_cube(6, 0.1, 0)
    allowed = np.roll(np.eye(6, dtype=bool), 1, axis=0)
    problem = Problem.from_user(target, source, allowed=allowed)
    best = least_energy(problem, np.eye(3))
    assert evaluate(problem, np.eye(3)[None], np.zeros((1, 1, 3)))[0][0] == pytest.approx(best)


def test_the_bound_approaches_the_energy_with_the_square_of_the_radius():
    problem = Problem.from_user(*planted_cube(10, 0.02, 1))
    energies = []
    for radius in (1e-2, 1e-3):
        least = least_energy(problem, np.eye(3))
        found = evaluate(problem, np.eye(3)[None], cubes(radius, 1), least)
        energies.append(least - found[0][0])
    assert energies[0] == pytest.approx(100 * energies[1], rel=0.1)


def test_cells_that_known_maps_show_to_be_open_are_not_bounded():
    problem = Problem.from_user(*planted_cube(20, 0.2, 3))
    rotations, reach = random_rotations(3, 50, np.random.default_rng(1)), cubes(0.1, 50)
    evaluating = QuasiBounds(problem)
    first = evaluating(rotations, reach, MUCH)
    again = evaluating(rotations, reach, MUCH)
    assert not again[2].any()
    assert (again[3] <= first[3] + 1e-9).all()
    assert (again[0] >= first[0] - 1e-9).all()
    near = evaluating(rotations, reach, float(np.median(first[0])) - 1e-6)
    assert 10 < near[2].sum() < 50
    assert (near[0] <= first[3]).all()
