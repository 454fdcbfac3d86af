import numpy as np
import pytest

from data_tools.datasets.public import read_teeth
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import OptionsError
from pairwise.branch_and_bound.bounds import BallBounds
from pairwise.branch_and_bound.cells import Cells
from pairwise.branch_and_bound.prove import can_certify, certify, prove
from pairwise.local.rotation_sets import random_rotations, rotation_angles
from pairwise.problem.problem import Problem
from pairwise.results import Candidate
from pairwise.status import Status
from pairwise.tight.problem import chiralities, energy_scale
from tests.oracles import brute_force, check_pose, injective_maps
from tests.tight_problems import planted_cube, small_problem


def in_ball(rotations, radii, num, rng):
    """Random rotations at most that far from each of the given ones, shape (num, m, d, d)."""
    m, d, _ = rotations.shape
    fractions = rng.random((num, m)) ** (1 / 3)
    if d == 2:
        angles = radii * fractions * rng.choice([-1.0, 1.0], (num, m))
        turns = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]).transpose(2, 3, 0, 1)
        return rotations @ turns
    axes = rng.standard_normal((num, m, 3))
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    cross = np.zeros((num, m, 3, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -axes[..., 2], axes[..., 1], -axes[..., 0]
    cross -= np.swapaxes(cross, 2, 3)
    angles = (radii * fractions)[..., None, None]
    return rotations @ (np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * cross @ cross)


@pytest.mark.parametrize("dim", [2, 3])
def test_every_rotation_lies_in_exactly_one_leaf_and_its_ball(dim, rng):
    cells = Cells.whole(dim)
    for _ in range(2):
        cells = cells.split()
    centres, radii = cells.balls()
    rotations = random_rotations(dim, 400, rng)
    angles = rotation_angles(rotations[:, None], centres)
    assert (angles <= radii).any(axis=1).all()
    assert len(np.unique(np.hstack([cells.faces[:, None], cells.centres]), axis=0)) == len(cells)


def test_balls_shrink_with_the_cells():
    cells = Cells.whole(3)
    for _ in range(3):
        children = cells.split()
        assert children.balls()[1].max() < 0.75 * cells.balls()[1].max()
        cells = children


@pytest.mark.parametrize("seed", range(24))
def test_ball_bounds_are_below_every_energy_in_the_ball(seed):
    _, problem = chiralities(small_problem(seed))[-1]
    rng = np.random.default_rng(seed)
    rotations = random_rotations(problem.dim, 12, rng)
    radii = rng.choice([1e-4, 0.02, 0.2, 0.7, 2.0], 12)
    bounds, energies, maps = BallBounds(problem)(rotations, radii, np.inf)
    inside = in_ball(rotations, radii, 40, rng)
    assert (rotation_angles(inside, rotations) <= radii + 1e-6).all()
    for index in range(12):
        own = np.append(inside[:, index], rotations[None, index], axis=0)
        assert bounds[index] <= min(lowest_energy(problem, r) for r in own) + 1e-12
        assert energies[index] == pytest.approx(problem.energy(rotations[index], maps[index]), abs=1e-9)


def lowest_energy(problem, rotation):
    """The best energy of any map at a fixed rotation, by brute force."""
    costs = problem.assignment_costs(rotation)
    maps = injective_maps(problem.candidates)
    return costs[maps, np.arange(costs.shape[1])].sum(axis=1).min()


def test_the_bound_is_exact_in_a_ball_where_the_map_stays_best():
    target, source = planted_cube(10, 0.02, 1)
    problem = Problem.from_user(target, source)
    best = prove(problem).candidate
    bound, _, _ = BallBounds(problem)(best.R_target_source[None], np.array([0.01]), np.inf)
    assert bound[0] == pytest.approx(best.energy, abs=1e-8)


@pytest.mark.parametrize("seed", range(42))
def test_small_problems_are_proven_and_agree_with_brute_force(seed):
    problem = small_problem(seed)
    proof = prove(problem, tol=1e-4)
    optimum, scale = brute_force(problem).energy, energy_scale(problem)
    assert proof.status is Status.PROVEN_OPTIMAL
    assert proof.lower_bound <= optimum + 1e-12 * scale
    assert proof.candidate.energy == pytest.approx(optimum, rel=2e-4, abs=1e-8 * scale)
    pose = proof.candidate
    assert check_pose(problem, pose.R_target_source, pose.map_target_source, pose.energy) == []
    if proof.is_chirality_proven:
        assert problem.pattern.special_blocks == ()
        worse = [p for mirrored, p in chiralities(problem) if mirrored != pose.reflected]
        assert brute_force(worse[0]).energy > pose.energy


def test_mirror_decisions_are_proven_only_where_there_is_one():
    target, source = planted_cube(10, 0.05, 4)
    chiral = prove(Problem.from_user(target, -source, group="O"))
    assert chiral.candidate.reflected
    assert chiral.is_chirality_proven
    assert chiral.proper_bound > chiral.candidate.energy
    flat = target * [1.0, 1.0, 0.0]
    assert not prove(Problem.from_user(flat, flat[::-1], group="O")).is_chirality_proven
    assert not prove(Problem.from_user(target, source)).is_chirality_proven


def test_noisy_problem_of_twenty_points_is_proven():
    problem = Problem.from_user(*planted_cube(20, 0.1, 0))
    bound, best, status = certify(problem, tol=1e-3, time_limit_s=60)
    assert status is Status.PROVEN_OPTIMAL
    assert bound >= (1 - 1e-3) * best.energy - 1e-8
    assert bound <= best.energy


def test_known_poses_are_used_and_the_time_limit_keeps_bounds_valid():
    problem = Problem.from_user(*planted_cube(16, 0.3, 2))
    full = prove(problem)
    short = prove(problem, [full.candidate], time_limit_s=1e-3)
    assert short.status is Status.TIME_LIMIT
    assert short.candidate.energy <= full.candidate.energy * (1 + 1e-9)
    assert 0.0 <= short.lower_bound <= full.candidate.energy


def test_the_relaxation_takes_over_after_half_of_the_time():
    problem = Problem.from_user(*planted_cube(16, 0.05, 2))
    proof = prove(problem, tol=1e-12, time_limit_s=2.0)
    assert proof.lower_bound == pytest.approx(proof.candidate.energy, rel=1e-6)


@pytest.mark.data
def test_a_pair_of_teeth_is_proven_with_its_chirality(shared_data):
    teeth = read_teeth(shared_data / "teeth_pnas116")
    left, right = (int(np.flatnonzero(teeth.chirality == side)[0]) for side in (1, -1))
    clouds = []
    for index in (left, right):
        shape = teeth.shape(index)
        points = shape.vertices[farthest_points(shape, 16, metric="euclidean")]
        points = points - points.mean(axis=0)
        clouds.append(points / np.linalg.norm(points))
    proof = prove(Problem.from_user(*clouds, group="O"), time_limit_s=60)
    assert proof.status is Status.PROVEN_OPTIMAL
    assert proof.is_chirality_proven


def test_what_cannot_be_certified_is_refused():
    target, source = planted_cube(6, 0.1, 0)
    problem = Problem.from_user(target, source)
    assert can_certify(problem)
    four = Problem.from_user(np.eye(4), np.eye(4))
    assert not can_certify(four)
    with pytest.raises(OptionsError, match="dimension 2 or 3"):
        prove(four)
    with pytest.raises(OptionsError, match="tol"):
        prove(problem, tol=0.0)
    with pytest.raises(OptionsError, match="time_limit_s"):
        prove(problem, time_limit_s=-1.0)


def test_a_bad_candidate_does_no_harm():
    problem = Problem.from_user(*planted_cube(8, 0.05, 2))
    bad = Candidate(
        R_target_source=np.eye(3), map_target_source=np.arange(8), energy=99.0, reflected=False, origin="start"
    )
    assert prove(problem, [bad]).candidate.energy == pytest.approx(prove(problem).candidate.energy)
