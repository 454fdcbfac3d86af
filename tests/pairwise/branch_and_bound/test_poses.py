import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_tools.errors import InputError, OptionsError
from pairwise import all_poses
from pairwise.branch_and_bound.pose_lists import list_poses
from pairwise.problem import Problem, chiralities, energy_scale
from pairwise.results import Status
from tests.oracles import every_pose
from tests.rigid_problems import is_pointed, planted_cube, rigid_problem


def missed_poses(problem, poses):
    """Rotations of poses of at most the list's energy that no region holds, by brute force."""
    missed = []
    for reflected, part in chiralities(problem):
        energies, rotations, _ = every_pose(part)
        signs = np.sign(part.source.sum() / problem.source.sum()) if reflected else 1.0
        for rotation in rotations[energies <= poses.energy - 1e-9 * energy_scale(problem)]:
            own = rotation * (
                signs if problem.dim == 3 else np.array([1.0, -1.0]) if reflected else 1.0
            )
            if not any(region.holds(own) for region in poses.regions):
                missed.append(own)
    return missed


@pytest.mark.parametrize("seed", range(28))
def test_no_pose_is_missed(seed):
    problem = rigid_problem(seed)
    limit_s = None if is_pointed(problem) else 0.3
    poses = list_poses(
        problem, within=1.0 + 0.3 * (seed % 3), resolution_deg=15.0, time_limit_s=limit_s
    )
    if is_pointed(problem):
        assert poses.is_resolved
        assert poses.proof.status is Status.PROVEN_OPTIMAL
    assert poses.candidates[0].energy == pytest.approx(poses.proof.candidate.energy)
    assert missed_poses(problem, poses) == []


def test_the_check_sees_a_missing_region():
    problem = Problem.from_user(*planted_cube(6, 0.3, 2))
    poses = list_poses(problem, within=1.5)
    lacking = type(poses)(
        regions=poses.regions[1:], energy=poses.energy, is_resolved=True, proof=poses.proof
    )
    assert missed_poses(problem, lacking)


def test_a_symmetric_shape_has_one_region_per_symmetry():
    rng = np.random.default_rng(0)
    third = rng.random((5, 3)) + np.array([0.5, 0.0, -0.5])
    turn = Rotation.from_euler("z", 120.0, degrees=True).as_matrix()
    points = np.concatenate([third, third @ turn.T, third @ turn])
    poses = all_poses(points, points + 0.01 * rng.standard_normal(points.shape), within=4.0)
    assert len(poses.regions) == len(poses.candidates) == 3
    for power in range(3):
        assert (
            sum(region.holds(np.linalg.matrix_power(turn, power)) for region in poses.regions) == 1
        )


def test_bad_options_are_refused():
    target, source = planted_cube(6, 0.1, 0)
    with pytest.raises(OptionsError, match="within"):
        all_poses(target, source, within=0.9)
    with pytest.raises(OptionsError, match="resolution_deg"):
        all_poses(target, source, resolution_deg=0)
    with pytest.raises(InputError, match="source"):
        all_poses(source[:4], source)


def test_descents_that_swap_maps_of_equal_energy_do_not_both_vanish():
    problem = rigid_problem(1168, max_target=7)
    poses = list_poses(problem, resolution_deg=15.0, time_limit_s=600.0)
    assert poses.is_resolved
    assert missed_poses(problem, poses) == []
